"""Scenes from USD."""
