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

SIZE = (16, 12)

AXES: dict[str, tuple[str, ...]] = {
    "method": ("analytic", "analytic", "analytic", "stochastic", "accumulation"),
    "camera": ("still", "moving", "moving"),
    "lens": ("pinhole", "pinhole", "round", "blades", "pull"),
    "curve": ("box", "curve"),
    "rolling": ("", "", "rows", "columns"),
    "shading": ("unlit", "phong", "metallic_roughness", "mixed"),
    "lights": ("sun", "lamps", "spots"),
    "shadows": ("", "", "shadows"),
    "texture": ("", "color", "all"),
    "color": ("", "face", "vertex"),
    "alpha": ("opaque", "opaque", "blend", "varying", "mask"),
    "sides": ("double", "single"),
    "mirror": ("", "", "flat", "glossy"),
    "around": ("color", "color", "image", "light", "sky"),
    "sampling": (*4 * ("centre",), "box", "triangle", "gaussian", "blackman_harris", "mitchell"),
    "layers": ("", "moment", "cryptomatte", "deep"),
}
"""What is combined; a value that stands twice is drawn twice as often."""


@dataclass(frozen=True)
class Effects:
    """One value of each of ``AXES``."""

    method: str = "analytic"
    camera: str = "still"
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
        if found.method == "accumulation":  # slices at rest have one pattern for all pixels
            return replace(found, sampling="centre")
        if found.sampling == "centre" and (
            found.lens != "pinhole" or found.mirror == "glossy" or found.method == "stochastic"
        ):
            return replace(found, sampling="box")
        return found

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


def build(recipe: Recipe) -> Case:
    """The scene of ``recipe`` and what it is rendered with."""
    return _Builder(recipe).case()


class _Builder:
    def __init__(self, recipe: Recipe) -> None:
        self.effects, self.count = recipe.effects, recipe.meshes
        self.rng = np.random.default_rng([recipe.seed, recipe.meshes])
        self.frame = float(self.rng.choice([0.0, 3.0, -2.0]))
        self.open, self.close = ((-0.25, 0.25), (0.0, 0.5), (-0.5, 0.5))[self.rng.integers(3)]
        self.limits = {} if self.effects.lens == "pinhole" else self.lens_limits()

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
        else:
            settings["filter"] = e.sampling
        if e.lens == "pull":  # of which none are chosen
            settings["motion_segments"] = 32
        if e.layers:
            settings["aovs"] = {
                "moment": ("sharp", "depth", "normal", "uv", "object", "material",
                           *(() if e.rolling else ("forward", "backward"))),
                "cryptomatte": ("crypto_object", "crypto_material"),
                "deep": ("deep",),
            }[e.layers]  # fmt: skip
        centre = e.sampling == "centre"
        asked = Asked(
            strata=16, repeats=16, centre=centre, filter="box" if centre else e.sampling,
            depths=THICK if e.layers == "deep" else (), seed=int(self.rng.integers(1 << 30)),
        )  # fmt: skip
        return Case(scene, self.frame, settings, repeats, asked, self.allowed())

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
        if self.limits:
            found.append(self.ramp())
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
        track = Track(self.frame + np.array([-1.0, 1.0]), ends, "linear", True)
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
        """Two keys a frame or more before and after the shutter, so that nothing bends in it."""
        ends = middle + self.between(-reach, reach, 2, len(middle))
        return Track(self.frame + np.array([-1.0, 1.0]), ends)

    def ramp(self) -> Mesh:
        """A large triangle away from the eye, which limits of the lens bend more than once."""
        given: dict[str, Any] = {
            "positions": np.array([[-1.8, -0.9, 2.5], [1.8, -0.8, 2.2], [0.1, 0.1, -1.9]]),
            "faces": [[0, 1, 2]],
        }
        self.add_attributes(given)
        self.slide(given, np.zeros(3))
        return Mesh(material=self.material(), name="ramp", **given)

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
                      "roughness": float(self.between(0.4, 0.9))}  # fmt: skip
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
        if self.limits:
            given |= self.limits | {"f_stop": float(self.between(0.1, 0.3))}
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

    def lens_limits(self) -> dict[str, Any]:
        """Numbers alone: kernels are the same without."""
        sharp = {"sharp_range": tuple(self.between([2.8, 4.2], [4.0, 5.5]))}
        before = {"foreground_blur": float(self.between(0.005, 0.06))}
        return self.pick({}, sharp, before, sharp | before)

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
        else:
            aim = self.between(-0.5, 0.5, 3) - place
            found.append(Light("spot", position=tuple(place), direction=tuple(aim), intensity=9.0,
                               inner_angle=8.0, outer_angle=25.0, shadows=cast))  # fmt: skip
        return found

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
