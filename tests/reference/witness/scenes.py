"""Scenes that combine effects at random, and how the witness and the product look at them.

`Effects` is what kernels are compiled for; a `Recipe` is effects and a seed, from which `build`
makes a scene: all else of it is free. So a few dozen sets of effects serve any number of scenes.
What is left out until it is mended has a case in ``tests/test_witness_cases.py``.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from hypothesis import strategies as st

from .film import Asked
from .product import (
    Camera,
    Environment,
    Light,
    Material,
    Mesh,
    Morph,
    MorphedSkin,
    NodeJoints,
    Scene,
    Shutter,
    Skin,
    Texture,
    Track,
    Transform,
)
from .tracks import rotations

SIZE = (16, 12)

AXES: dict[str, tuple[str, ...]] = {
    "method": ("analytic", "analytic", "analytic", "stochastic", "accumulation"),
    "camera": ("still", "moving", "moving"),
    "keys": ("outside",),  # "inside" the shutter: test_witness_left_out.py
    "lens": ("pinhole", "pinhole", "round", "blades", "pull"),
    "curve": ("box", "curve"),
    "rolling": ("", "", "rows", "columns"),
    "shading": ("unlit", "phong", "metallic_roughness", "mixed"),
    "lights": ("sun", "lamps", "spots"),  # "moving": test_witness_left_out.py
    "shadows": ("", "", "shadows"),
    "texture": ("", "color", "all"),
    "color": ("", "face", "vertex"),
    "alpha": ("opaque", "opaque", "blend", "varying", "mask"),
    "sides": ("double", "single"),
    "mirror": ("", "", "flat", "glossy"),
    "around": ("color", "color", "image", "light", "sky"),
    "sampling": (
        *4 * ("centre",),
        "box",
        "triangle",
        "gaussian",
        "blackman_harris",
        "mitchell",
        "five_point",
    ),
    "layers": ("", "moment", "cryptomatte", "deep", "events"),
}
"""What is combined; a value that stands twice is drawn twice as often."""


@dataclass(frozen=True)
class Effects:
    """One value of each of ``AXES``."""

    method: str = "analytic"
    camera: str = "still"
    keys: str = "outside"
    lens: str = "pinhole"
    curve: str = "box"
    rolling: str = ""
    shading: str = "unlit"
    lights: str = "sun"
    shadows: str = ""
    texture: str = ""
    color: str = ""
    alpha: str = "opaque"
    sides: str = "double"
    mirror: str = ""
    around: str = "color"
    sampling: str = "box"
    layers: str = ""

    def consistent(self) -> Effects:
        """The same without what does not go together, or is not asked of the method."""
        found = self
        if found.method != "analytic" or (
            found.sampling == "mitchell" and found.layers in ("cryptomatte", "deep")
        ):
            found = replace(found, layers="")
        if found.sampling == "five_point" and (
            found.method != "analytic" or found.layers not in ("", "moment")
        ):
            found = replace(found, sampling="centre")
        if found.method == "accumulation":  # slices at rest have one pattern for all pixels
            return replace(found, sampling="centre")
        if found.sampling in ("centre", "five_point") and (
            found.lens != "pinhole" or found.mirror == "glossy" or found.method == "stochastic"
        ):
            return replace(found, sampling="box")
        return found

    @property
    def steady(self) -> bool:
        """Whether alpha is constant on each surface."""
        return self.alpha == "opaque" or (self.alpha == "blend" and self.color != "vertex")

    @property
    def calm(self) -> bool:
        """Whether brightness changes where visibility does, and at once."""
        plain = self.shading == "unlit" and not self.texture and self.color != "vertex"
        return plain and self.steady and self.around == "color"

    @property
    def pairs(self) -> set[tuple[tuple[str, str], ...]]:
        """All pairs of its values."""
        return set(combinations(sorted(asdict(self).items()), 2))


@lru_cache(maxsize=4)
def effect_sets(count: int) -> tuple[Effects, ...]:
    """``count`` sets, each of fifty random ones that which has most pairs that are new."""
    rng = np.random.default_rng(18)
    known: set[tuple[tuple[str, str], ...]] = set()
    found: list[Effects] = []
    for _ in range(count):
        drawn = [
            Effects(**{axis: str(rng.choice(values)) for axis, values in AXES.items()}).consistent()
            for _ in range(50)
        ]
        found.append(max(drawn, key=lambda effects: len(effects.pairs - known)))
        known |= found[-1].pairs
    return tuple(found)


@dataclass(frozen=True)
class Recipe:
    """What a scene is made from."""

    effects: Effects
    seed: int
    meshes: int = 3

    def __str__(self) -> str:
        given = [(f.name, getattr(self.effects, f.name)) for f in fields(Effects)]
        told = ", ".join(f"{name}={value!r}" for name, value in given
                         if value != getattr(Effects, name))  # fmt: skip
        return f"Recipe(Effects({told}), seed={self.seed}, meshes={self.meshes})"


@st.composite
def recipes(draw: st.DrawFn, sets: int) -> Recipe:
    """Recipes from ``sets`` sets of effects."""
    return Recipe(
        draw(st.sampled_from(effect_sets(sets))),
        draw(st.integers(0, 2**32 - 1)),
        draw(st.integers(1, 4)),
    )


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, how the package renders it and how the witness does; ``frame`` is where."""

    scene: Scene
    frame: float
    settings: dict[str, Any]
    repeats: int
    asked: Asked
    allowed: float
    effects: Effects
    parts: tuple[tuple[float, float], ...] = ()
    """Of the exposure, which events are integrated over."""
    read: Any = None
    """What the witness looks at, where it reads a file itself."""

    @property
    def seen(self) -> Any:
        """What the witness looks at."""
        return self.scene if self.read is None else self.read


def build(recipe: Recipe) -> Case:
    """The scene of ``recipe`` and what it is rendered with."""
    return _Builder(recipe).case()


class _Builder:
    def __init__(self, recipe: Recipe) -> None:
        self.recipe, self.effects, self.count = recipe, recipe.effects, recipe.meshes
        self.rng = np.random.default_rng([recipe.seed, recipe.meshes])
        self.more = np.random.default_rng([recipe.seed, recipe.meshes, 2])  # of what came later
        self.frame = float(self.rng.choice([0.0, 3.0, -2.0]))
        self.open, self.close = ((-0.25, 0.25), (0.0, 0.5), (-0.5, 0.5))[self.rng.integers(3)]

    def case(self) -> Case:
        e = self.effects
        scene = Scene(
            meshes=self.meshes(),
            camera=self.camera(),
            lights=self.lights(),
            background=self.background(),
            shutter=self.shutter(),
            environment=self.environment(),
        )
        settings: dict[str, Any] = {"shading_error": 5e-4, "samples": 32, "pattern": "sobol"}
        repeats = 8
        if e.method == "stochastic":
            settings |= {"method": "stochastic", "samples": 32}
            del settings["shading_error"]
        elif e.method == "accumulation":
            settings |= {"method": "accumulation", "slices": 32, "slice_times": "jittered"}
            del settings["shading_error"]
        if e.sampling == "centre":
            settings |= {"samples": 1, "pattern": "fixed"}
            repeats = 1 if e.method == "analytic" else repeats
        elif e.sampling == "five_point":
            settings |= {"samples": 1, "pattern": "fixed", "filter": "five_point"}
            repeats = 1
        else:
            settings["filter"] = e.sampling
        if e.lens == "pull":  # of which none are chosen
            settings["motion_segments"] = 20
        if e.layers:
            settings["aovs"] = {
                "moment": ("sharp", "depth", "normal", "uv", "object", "material",
                           *(() if e.rolling else ("forward", "backward"))),
                "cryptomatte": ("crypto_object", "crypto_material"),
                "deep": ("deep",),
                "events": ("events",),
            }[e.layers]  # fmt: skip
        centre = e.sampling in ("centre", "five_point")
        asked = Asked(
            strata=16, repeats=16, centre=centre,
            filter="box" if e.sampling == "centre" else e.sampling,
            depths=THICK if e.layers == "deep" else (), seed=int(self.rng.integers(1 << 30)),
        )  # fmt: skip
        return Case(
            scene, self.frame, settings, repeats, asked, self.allowed(), e, self.event_parts()
        )

    def event_parts(self) -> tuple[tuple[float, float], ...]:
        """Limits at the parts of the exposure in which events have colours of their own.

        And others where colours are constant.
        """
        if self.effects.layers != "events":
            return ()
        aligned = ((0.0, 0.25), (0.25, 0.75), (0.5, 1.0))[self.recipe.seed % 3]
        return (aligned, (0.3, 0.61)) if self.effects.calm else (aligned,)

    def allowed(self) -> float:
        """What colours may be off by: `shading_error`, and what the README says of environments."""
        e = self.effects
        if e.around in ("light", "sky"):
            return 0.005
        return 5e-4

    def between(self, low: Any, high: Any, *size: int) -> np.ndarray:
        return np.round(self.rng.uniform(low, high, size or np.shape(low)), 4)

    def pick(self, *values: Any) -> Any:
        return values[self.rng.integers(len(values))]

    # Surfaces

    def meshes(self) -> list[Mesh]:
        found = [self.mesh(number) for number in range(self.count)]
        if self.effects.mirror:
            found.append(self.mirror())
        found.append(self.wall())
        return found

    def mesh(self, number: int) -> Mesh:
        """A few triangles in view that move in one of many ways, the first of them surely."""
        corners = 3 * self.pick(1, 2, 3)
        centre = self.between([-1.2, -0.8, -1.5], [1.2, 0.8, 1.0])
        shape = self.between(-0.9, 0.9, corners, 3)
        faces = np.arange(corners).reshape(-1, 3)
        if self.pick(True, False):  # a tent of faces that share edges
            shape = np.array([[-0.8, -0.6, 0], [0.8, -0.6, 0.1], [0.8, 0.6, 0], [-0.8, 0.6, 0.1],
                              [0.0, 0.0, 0.5]]) * self.between(0.5, 1.0, 3)  # fmt: skip
            faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
        given: dict[str, Any] = {"positions": shape, "faces": faces}
        self.add_attributes(given)
        ways = (self.slide, self.turn, self.spline, self.arrays, self.nest, self.morph, self.skin)
        if number > 0:
            ways += (self.rest, self.own_shutter)
            if not (self.effects.mirror and self.effects.shadows):  # a case of its own
                ways += (self.appear,)
        way = self.pick(*ways)
        # Flat normals of what deforms are chords between the ends of segments.
        if way in (self.arrays, self.morph) or self.pick(True, False):
            given["normals"] = shape * 0.6 + self.between(-0.1, 0.1, *shape.shape) + [0, 0, 1.0]
        way(given, centre)
        return Mesh(material=self.material(), name=f"mesh {number}", **given)

    def add_attributes(self, given: dict[str, Any]) -> None:
        e, count, faces = self.effects, len(given["positions"]), len(given["faces"])
        if e.texture or e.alpha == "varying":
            given["uv"] = given["positions"][:, :2] * self.between(0.4, 1.2) + 0.5
        if e.color == "face":
            given |= {"color": self.between(0.2, 1.0, faces, 3), "color_domain": "face"}
        elif e.color == "vertex":
            width = 4 if e.alpha != "opaque" else 3
            given |= {"color": self.between(0.2, 1.0, count, width), "color_domain": "vertex"}

    def slide(self, given: dict[str, Any], centre: np.ndarray) -> None:
        given["transform"] = Transform(translation=self.keys(centre, 1.2))

    def turn(self, given: dict[str, Any], centre: np.ndarray) -> None:
        ends = self.between(-1.0, 1.0, 2, 4) + [0, 0, 0, 0.3]
        track = self.track(ends, True)
        given["transform"] = Transform(translation=tuple(centre), rotation=track)

    def spline(self, given: dict[str, Any], centre: np.ndarray) -> None:
        values = np.stack([self.between(-1.0, 1.0, 3), centre, self.between(-1.0, 1.0, 3)])
        values = np.stack([values, values + self.between(-0.5, 0.5, 3, 3)])
        track = Track(self.frame + np.array([-1.0, 1.5]), values, "cubic")
        scale = self.keys(np.ones(3), 0.3)
        given["transform"] = Transform(translation=track, scale=scale)

    def arrays(self, given: dict[str, Any], centre: np.ndarray) -> None:
        start = given["positions"] + centre
        given["positions"] = start + self.between(-0.4, 0.4, self.pick(2, 3), *start.shape)
        if "normals" in given and self.pick(True, False):
            more = self.between(-0.2, 0.2, len(given["positions"]), *start.shape)
            given["normals"] = given["normals"] + more

    def nest(self, given: dict[str, Any], centre: np.ndarray) -> None:
        root: dict[str, Any] = {}
        self.turn(root, centre)
        given["transform"] = Transform(
            translation=self.keys(np.zeros(3), 0.5), scale=tuple(self.between(0.5, 1.2, 3)),
            parent=root["transform"],
        )  # fmt: skip

    def morph(self, given: dict[str, Any], centre: np.ndarray) -> None:
        targets = self.between(-0.5, 0.5, 2, *given["positions"].shape)
        weights = Track(self.frame + np.array([-1.0, 1.0]), self.between(-1, 1, 2, 2))
        changed = None
        if "normals" in given:
            changed = self.between(-0.3, 0.3, 2, *given["positions"].shape)
        given["deformer"] = MorphedSkin(
            given["positions"], given.get("normals"), Morph(targets, changed, weights)
        )
        given["transform"] = Transform(translation=tuple(centre))

    def skin(self, given: dict[str, Any], centre: np.ndarray) -> None:
        first: dict[str, Any] = {}
        second: dict[str, Any] = {}
        self.turn(first, centre)
        self.slide(second, centre)
        count = len(given["positions"])
        inverse = np.tile(np.eye(4), (2, 1, 1))
        inverse[:, :3, 3] = self.between(-0.3, 0.3, 2, 3)
        share = self.between(0.1, 1.0, count, 2)
        bones = NodeJoints((first["transform"], second["transform"]), inverse)
        skin = Skin(bones, np.tile([[0, 1]], (count, 1)), share)
        given["deformer"] = MorphedSkin(given["positions"], given.get("normals"), skin=skin)

    def rest(self, given: dict[str, Any], centre: np.ndarray) -> None:
        given["transform"] = Transform(translation=tuple(centre))

    def appear(self, given: dict[str, Any], centre: np.ndarray) -> None:
        self.slide(given, centre)
        at = self.frame + self.open + self.between(0.2, 0.8) * (self.close - self.open)
        given["visible"] = Track([self.frame - 1.0, float(at)], [0.0, 1.0], "step")

    def own_shutter(self, given: dict[str, Any], centre: np.ndarray) -> None:
        self.slide(given, centre)
        given |= self.pick({"shutter_scale": 0.5}, {"shutter_scale": 1.5}, {"motion_blur": False})

    def keys(self, middle: np.ndarray, reach: float) -> Track:
        """Keys about ``middle``, no more than ``reach`` away."""
        return self.track(middle + self.between(-reach, reach, 2, len(middle)))

    def track(self, ends: np.ndarray, quaternion: bool = False) -> Track:
        """Two keys half a frame or more beyond the shutter, so that nothing bends in it.

        If keys lie inside of it, a third one does.
        """
        frames = self.frame + np.array([-1.0, 1.0])
        if self.effects.keys == "inside":
            part = self.more.uniform(0.1, 0.9)
            frames = np.insert(frames, 1, self.frame + self.open + part * (self.close - self.open))
            ends = np.insert(ends, 1, self.more.permutation(ends.ravel()).reshape(2, -1)[0], axis=0)
        return Track(frames, ends, "linear", quaternion)

    def wall(self) -> Mesh:
        """Rests behind everything, and takes shadows."""
        given: dict[str, Any] = {
            "positions": np.array([[-2.5, -1.2, -2.2], [2.2, -1.4, -2.4], [0.1, 1.4, -2.0]]),
            "faces": [[0, 1, 2]],
        }
        self.add_attributes(given)
        material = replace(self.material(), opacity=1.0, alpha_mode="opaque")
        return Mesh(material=material, name="wall", **given)

    def mirror(self) -> Mesh:
        shear = 0.15 if self.effects.mirror == "glossy" else 0.0
        material = Material(
            "mirror", base_color=tuple(self.between(0.1, 0.6, 3)), shading="unlit",
            reflectivity=float(self.between(0.3, 0.9)), reflection_shear=shear,
        )  # fmt: skip
        if self.pick(True, False):  # a floor, or a wall to the right
            points = [[-2.5, -1.0, 1.5], [2.5, -1.0, 1.5], [2.5, -1.0, -2.0], [-2.5, -1.0, -2.0]]
        else:
            points = [[1.3, -1.5, 1.5], [1.6, -1.5, -2.0], [1.6, 1.5, -2.0], [1.3, 1.5, 1.5]]
        return Mesh(points, [[0, 1, 2], [0, 2, 3]], material=material, name="mirror")

    def material(self) -> Material:
        e = self.effects
        shading = e.shading
        if shading == "mixed":
            shading = self.pick("unlit", "phong", "metallic_roughness")
        given: dict[str, Any] = {
            "name": f"material {self.rng.integers(1 << 30)}",
            "shading": shading,
            "base_color": tuple(self.between(0.2, 1.0, 3)),
            "double_sided": e.sides == "double",
        }
        if shading == "phong":
            given |= {"specular": (0.3, 0.2, 0.1), "shininess": float(self.between(3, 20))}
        if shading == "metallic_roughness":
            given |= {"metallic": float(self.pick(0.0, 0.5, 1.0)),
                      "roughness": float(self.between(0.4, 0.9).round(1))}  # fmt: skip
        if shading != "unlit" and e.texture == "all":
            given["emission"] = tuple(self.between(0.0, 0.3, 3))
            given["emission_texture"] = self.texture(3)
            if shading == "metallic_roughness" and e.around not in ("light", "sky"):
                given["metallic_roughness_texture"] = self.texture(3)
        if e.texture or e.alpha == "varying":
            given["texture"] = self.texture(4 if e.alpha in ("varying", "mask") else 3)
        if e.alpha == "blend":
            given |= {"opacity": float(self.between(0.2, 0.9)), "alpha_mode": "blend"}
        elif e.alpha == "varying":
            given |= {"opacity": float(self.between(0.6, 1.0)), "alpha_mode": "blend"}
        elif e.alpha == "mask":
            given |= {"alpha_mode": "mask", "alpha_cutoff": float(self.between(0.3, 0.6))}
        return Material(**given)

    def texture(self, channels: int) -> Texture:
        image = self.between(0.1, 1.0, self.pick(3, 4), self.pick(4, 5), channels)
        return Texture(image, wrap=self.pick("repeat", "clamp", "mirror"))

    # All else

    def camera(self) -> Camera:
        e = self.effects
        given: dict[str, Any] = {}
        if e.lens != "pinhole":
            given |= {"f_stop": float(self.between(0.5, 1.5)), "meters_per_unit": 0.04,
                      "focus_distance": float(self.between(3.0, 5.5))}  # fmt: skip
        if e.lens == "blades":
            given |= {"blades": self.pick(3, 5, 6), "blade_rotation": float(self.between(0, 90))}
        if e.lens == "pull":
            given["focus_distance"] = Track(self.frame + np.array([-1.0, 1.0]),
                                            self.between(3.0, 5.5, 2))  # fmt: skip
        if e.camera == "still":
            return Camera(position=(0.1, 0.2, 4.0), look_at=(0, 0, 0), fov=40.0, **given)
        if self.pick(True, False):
            fov = Track(self.frame + np.array([-1.0, 1.0]), self.between(35, 50, 2))
            position, target = (self.keys(np.array(at), 0.4) for at in ([0, 0.2, 4.0], [0, 0, 0]))
            return Camera(position=position, look_at=target, fov=fov, **given)
        turn = self.between(-0.1, 0.1, 2, 4) * [1, 1, 1, 0] + [0, 0, 0, 1.0]
        frames = self.frame + np.array([-1.0, 1.0])
        place = Transform(
            translation=self.keys(np.array([0, 0.2, 4.0]), 0.4),
            rotation=Track(frames, turn, "linear", True),
        )
        return Camera(transform=place, focal_length=35.0, vertical_aperture=24.0, **given)

    def lights(self) -> list[Light]:
        e = self.effects
        if e.shading == "unlit":
            return []
        cast = bool(e.shadows)
        found = [Light("ambient", color=(0.2, 0.25, 0.3))]
        sun = Light("directional", direction=tuple(self.between([-1, -1, -2], [1, -0.3, -1])),
                    color=(0.9, 0.8, 0.7), shadows=cast)  # fmt: skip
        place = self.between([-1.5, 0.5, 2.0], [1.5, 2.0, 3.5])
        if e.lights == "sun":
            found.append(sun)
        elif e.lights == "lamps":
            found.append(Light("point", position=tuple(place), intensity=6.0, shadows=cast))
        elif e.lights == "moving":
            way = Transform(translation=self.keys(place, 1.0))
            return [*found, Light("point", intensity=6.0, shadows=cast, transform=way)]
        else:
            aim = self.between(-0.5, 0.5, 3) - place
            found.append(Light("spot", position=tuple(place), direction=tuple(aim), intensity=9.0,
                               inner_angle=8.0, outer_angle=25.0, shadows=cast))  # fmt: skip
        return [found[0], self.placed(found[1])]

    def placed(self, light: Light) -> Light:
        """A light that shines as before, but is moved there by a transform, at times."""
        if self.more.integers(2):
            return light
        axis = self.more.normal(size=4)
        turn = rotations(axis[None])[0]
        there = Transform(translation=(0.4, -0.3, 0.2), rotation=tuple(axis))
        return replace(
            light, transform=there, direction=tuple(turn.T @ light.direction),
            position=tuple(turn.T @ (np.array(light.position) - [0.4, -0.3, 0.2])),
        )  # fmt: skip

    def background(self) -> Any:
        if self.effects.around == "image":
            return self.between(0.0, 1.0, SIZE[1], SIZE[0], 3).astype(np.float32)
        return tuple(self.between(0.0, 0.5, 3))

    def environment(self) -> Environment | None:
        """Smooth light, so that texels are no matter: their own case is."""
        e = self.effects
        if e.around not in ("light", "sky"):
            return None
        up, turn = np.meshgrid(np.linspace(1, -1, 32), np.linspace(-np.pi, np.pi, 64, False),
                               indexing="ij")  # fmt: skip
        phases = self.between(0, 2 * np.pi, 3)
        wave = (
            0.4
            + 0.2 * up[..., None]
            + 0.15 * np.cos(turn[..., None] + phases) * (1 - up[..., None] ** 2)
        )
        return Environment(
            wave.astype(np.float32), intensity=1.0, rotation=float(self.between(0, 360)),
            background=e.around == "sky",
        )  # fmt: skip

    def shutter(self) -> Shutter:
        e = self.effects
        given: dict[str, Any] = {"open": self.open, "close": self.close}
        if e.curve == "curve":
            given |= self.pick(
                {"curve": "triangle"},
                {"curve": "trapezoid", "opening": 0.2, "closing": 0.5},
                {"curve": tuple(self.between(0.1, 1.0, self.pick(2, 4)))},
            )
        if e.rolling:
            ways = ("down", "up") if e.rolling == "rows" else ("right", "left")
            lines = SIZE[1] if e.rolling == "rows" else SIZE[0]
            seconds = (self.close - self.open) / 24.0
            given |= {"rolling": self.pick(*ways), "line_offset": 0.6 * seconds / lines,
                      "line_exposure": 0.4 * seconds}  # fmt: skip
        return Shutter(**given)


DEPTHS = (3.2, 4.0, 4.8, 6.0)
"""Before which alpha of deep images is added up."""
THICK = tuple(float(depth * part) for depth in DEPTHS for part in (0.985, 1.015))
"""The same, and what a slice of a deep image hides."""
