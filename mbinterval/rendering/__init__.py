"""Rendering on the device: the methods, what they share, and the film that comes of it."""
