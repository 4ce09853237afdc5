"""How far films are from a reference, and whether noise explains it."""
