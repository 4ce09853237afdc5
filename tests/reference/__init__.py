"""The float64 twin of the renderer, in NumPy: what the kernels are tested against.

It shares no code with the kernels and takes nothing from the package but the exposed scene.
"""
