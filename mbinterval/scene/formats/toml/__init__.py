"""Scenes from mbinterval's own files: TOML, JSON and Python dicts."""
