"""The float64 twin of the renderer, in NumPy: what the kernels are tested against.

It shares no code with the kernels and takes nothing from the package but the exposed scene.
Read in this order: ``paths`` (homogeneous pixel space, the records), ``samples`` (where), ``hits``
(plain triangles), ``triangulated`` (Hong & Oh's intervals) or ``exact`` (root-solved ones),
``visibility`` (masks or the front envelope), ``shading``, ``render``. ``accumulation`` samples
time instead, and ``rational`` repeats single cases of ``exact`` in exact fractions.
"""
