"""Scenes from glTF."""
