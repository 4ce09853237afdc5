"""The witness: an independent float64 reference, which shares no code with the package or its twin.

It looks at a scene as its user gave it (keys, meshes, materials, lights, camera, shutter), freezes
it at random instants of the exposure by the keys themselves, without motion segments, sends rays
through it, and shades what they meet by the formulas of the README and of the docstrings. Nothing
is imported from `mbinterval` here but by `product`, which makes scenes and renders them, and by
`scenes`, which draws them.

    tracks      keys to values and matrices at instants
    motion      vertices, normals and attributes of all meshes at instants
    camera      rays of samples: pose, lens, limits of its blur
    exposure    the shutter: its curve, its lines
    filters     pixel filters
    cast        rays against triangles
    shade       materials, lights, shadows, textures
    around      the environment
    film        the mean over instants, with independent repeats
    moment      what the pixels' centres see at one moment
    streams     events: what they add up to, when each is seen, what an event camera reports
    gltf        glTF files, by the specification
    judge       whether two films differ by more than their noise

Scenes are drawn by `scenes`, `kinds` (one of each kind of effect) and `gltf_scenes` (files).
`compare` renders them, looks at them and judges.
"""
