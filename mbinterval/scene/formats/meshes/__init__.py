"""Scenes from files of meshes alone."""
