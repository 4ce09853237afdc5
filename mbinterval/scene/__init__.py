"""What is rendered: the animated scene, its frozen exposure, and one reader per file format."""
