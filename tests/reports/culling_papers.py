"""Figures that the papers on sample culling print."""

from __future__ import annotations

L11 = {
    "CONAN": {
        "none": (23.6, 23.6, 23.6, 23.6, 23.6),
        "motion": (2.7, 9.5, 17.7, 21.9, 23.7),
        "motion x2": (1.3, 6.0, 14.6, 20.9, 24.0),
        "defocus": (1.7, 4.4, 8.8, 13.9, 23.1),
        "defocus x2": (0.7, 1.8, 4.4, 8.8, 21.9),
        "both": (0.7, 1.2, 2.6, 4.3, 5.6),
        "both x2": (0.4, 0.6, 1.1, 2.0, 2.9),
    },
    "ASSASSIN": {
        "none": (23.2, 23.2, 23.2, 23.2, 23.2),
        "motion": (10.8, 19.5, 22.4, 23.1, 23.4),
        "motion x2": (4.3, 14.8, 21.2, 23.0, 23.6),
        "defocus": (9.5, 15.1, 19.0, 21.1, 23.2),
        "defocus x2": (4.3, 9.5, 15.1, 19.0, 23.0),
        "both": (4.5, 6.8, 7.2, 10.1, 14.1),
        "both x2": (1.3, 2.1, 3.9, 6.7, 6.9),
    },
    "CARS": {
        "none": (8.59, 8.60, 8.59, 8.60, 8.59),
        "motion": (0.50, 2.97, 6.43, 8.02, 8.63),
        "motion x2": (0.14, 1.27, 4.70, 7.40, 8.69),
        "defocus": (0.19, 0.59, 1.53, 3.13, 8.57),
        "defocus x2": (0.05, 0.19, 0.59, 1.53, 8.51),
        "both": (0.12, 0.25, 0.49, 1.08, 4.51),
        "both x2": (0.03, 0.07, 0.16, 0.39, 2.42),
    },
}
"""Laine et al. 2011, table 1: STE of bbox, modified Pixar at 4, 16 and 64 samples, their own."""

L11_UVT = {"city": 21.0, "crowd": 3.8}
"""Laine et al. 2011, 4.1: about the STE of InterleaveUVT in the games, and in CARS."""

L11_FIGURE_1 = (
    'few (u, v, t) triplets, "especially with low sample counts"',
    '"a good sampling pattern"',
)
"""What the caption of their figure 1 says of InterleaveUVT with 2 x 2 pixels, and of Sobol."""

L11_TILES = {
    "city": {"operations": (5, 54), "ste": (5, 10)},
    "crowd": {"operations": (26, 57), "ste": (16, 55)},
}
"""Laine et al. 2011, 4.1: by how many percent 2 x 2 pixels lower either, in games and in CARS."""

W15 = (
    ("Hand, 15k, defocus", "12 %, 135 ms", "29 %, 131 ms", "29 %, 123 ms"),
    ("Hand, defocus x2", "10 %, 140 ms", "28 %, 133 ms", "27 %, 126 ms"),
    ("Car, 54k, motion", "9 %, 178 ms", "28 %, 156 ms", "27 %, 158 ms"),
    ("Car, motion x2", "4 %, 185 ms", "25 %, 172 ms", "26 %, 166 ms"),
    ("Dragonfly, 85k, motion", "3 %, 156 ms", "23 %, 140 ms", "22 %, 136 ms"),
    ("Dragonfly, motion x2", "1 %, 161 ms", "24 %, 148 ms", "24 %, 138 ms"),
    ("Fairy forest, 170k, both", "0.4 %, 212 ms", "5 %, 183 ms", "19 %, 175 ms"),
    ("Fairy forest, both x2", "0.2 %, 222 ms", "2 %, 202 ms", "13 %, 188 ms"),
)
"""Wu et al. 2015, table 1: bbox, Laine et al. 2011, their own."""

AM07 = {"disc": (225, 314), "floor": (1056, 2314)}
"""Akenine-Möller et al. 2007, 4.4: megabytes of texture, four samples and four passes; their wheel
and their Sponza out of focus."""
