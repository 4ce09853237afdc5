"""Readers of scene files, one package per format."""
