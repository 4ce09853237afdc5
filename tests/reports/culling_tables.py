"""The published tables of sample culling, redone: sample test efficiency (STE), tests and seconds.

    python tests/reports/culling_tables.py [--quick] > culling.md

Scenes in place of the papers': a city of boxes under a moving camera (large triangles, some tens of
pixels: CONAN, ASSASSIN), a crowd of finely tessellated spheres that fly (triangles below a pixel:
CARS), and blades, a turning wheel. "motion x2" doubles the way, "defocus x2" the lens. 960 x 540
unless --quick. STE is hits over tests (Laine et al. 2011, 1), all paths in front of each other, no
depth culling.
"""

from __future__ import annotations

import argparse
import dataclasses
import time

import numpy as np

import mbinterval as mb

ROWS = ("none", "motion", "motion x2", "defocus", "defocus x2", "both", "both x2")


def city(motion: float, aperture: float) -> mb.Scene:
    """Boxes on a grid; the camera moves sideways and forwards, so everything does."""
    rng = np.random.default_rng(3)
    corners = np.array(np.meshgrid([-1, 1], [0, 1], [-1, 1], indexing="ij"), float).reshape(3, 8).T
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    points, triangles = [], []
    for x in range(-9, 10):
        for z in range(1, 24):
            size = np.array([0.35, rng.uniform(0.3, 3.0), 0.35])
            triangles.append(faces + 8 * len(points))
            points.append(corners * size + [1.2 * x, -1.0, -1.2 * z - 2.0])
    start = np.concatenate(points)
    step = np.array([0.10, 0.0, 0.18]) * motion
    return scene(start, start + step, np.concatenate(triangles), aperture, 6.0)


def crowd(motion: float, aperture: float) -> mb.Scene:
    """Spheres of 5,120 small triangles each, each flying its own way."""
    import trimesh

    rng = np.random.default_rng(4)
    ball = trimesh.creation.icosphere(subdivisions=4)
    starts, ends, triangles = [], [], []
    for k in range(30):
        at = rng.uniform((-2.6, -1.4, -9.0), (2.6, 1.4, -4.0))
        triangles.append(ball.faces + len(ball.vertices) * k)
        starts.append(0.35 * ball.vertices + at)
        ends.append(starts[-1] + motion * rng.normal(0, 0.12, 3))
    return scene(np.concatenate(starts), np.concatenate(ends), np.concatenate(triangles),
                 aperture, 6.0)  # fmt: skip


def scene(start, end, faces, aperture, focus):  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(5)
    still = bool(np.all(start == end))
    mesh = mb.Mesh(positions=start if still else np.stack([start, end]), faces=faces,
                   color=rng.uniform(0.2, 1.0, (len(faces), 3)), color_domain="face",
                   shading="unlit")  # fmt: skip
    lens = {"f_stop": 1.0 / aperture, "focus_distance": focus} if aperture else {}
    camera = mb.Camera(position=(0, 0, 0), focal_length=24.0, **lens)
    return mb.Scene(meshes=[mesh], camera=camera, background=(0.02, 0.02, 0.03))


SCENES = {"city": (city, 0.35), "crowd": (crowd, 0.5)}


def variants(name: str) -> dict[str, mb.Scene]:
    make, stop = SCENES[name]
    amounts = ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 1), (2, 2))
    return {row: make(m, a * 20 * stop) for row, (m, a) in zip(ROWS, amounts, strict=True)}


def measure(of: mb.Scene, size: tuple[int, int], **values: object) -> tuple[float, int, float]:
    """STE in percent, tests, and seconds of a second render without counting."""
    counted = mb.Settings(method="stochastic", statistics=True, **values)  # type: ignore[arg-type]
    stats = mb.render(of, width=size[0], height=size[1], settings=counted).stats
    plain = dataclasses.replace(counted, statistics=False)
    mb.render(of, width=size[0], height=size[1], settings=plain)
    started = time.perf_counter()
    mb.render(of, width=size[0], height=size[1], settings=plain)
    seconds = time.perf_counter() - started
    return 100.0 * stats["hits"] / max(stats["tests"], 1), stats["tests"], seconds


def laine_table(size: tuple[int, int]) -> None:
    print("### STE in percent, as in Laine et al. 2011, table 1\n")
    names = ("bbox", "pixar 4", "pixar 16", "pixar 64", "dual_space", "clip_space", "interleave")
    print(f"| scene | {' | '.join(names)} |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for name in SCENES:
        for row, of in variants(name).items():
            cells = [measure(of, size, cull="bbox", samples=16)[0]]
            cells += [measure(of, size, cull="pixar", samples=n)[0] for n in (4, 16, 64)]
            cells += [
                measure(of, size, cull=c, samples=16)[0] for c in ("dual_space", "clip_space")
            ]
            both = {"cull": "interleave_uvt", "pattern": "interleave_uvt"}
            cells.append(measure(of, size, samples=16, **both)[0])
            text = " | ".join(f"{cell:.2f}" for cell in cells)
            print(f"| {name}, {row} | {text} |", flush=True)


def wu_table(size: tuple[int, int]) -> None:
    print("\n### STE in percent and seconds, as in Wu et al. 2015, table 1 (16 samples)\n")
    print("| scene | bbox | dual_space | clip_space | as printed | hits lost | best |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for name in SCENES:
        for row, of in list(variants(name).items())[1:]:
            cells = []
            for cull in ("bbox", "dual_space", "clip_space", "clip_space_printed"):
                ste, _, seconds = measure(of, size, cull=cull, samples=16)
                cells.append(f"{ste:.1f}, {seconds:.2f} s")
            hits = [
                mb.render(of, width=size[0], height=size[1], settings=mb.Settings(
                    method="stochastic", samples=16, statistics=True, cull=cull)).stats["hits"]
                for cull in ("bbox", "clip_space_printed")
            ]  # fmt: skip
            lost = 100.0 * (1.0 - hits[1] / hits[0])
            best = measure(of, size, samples=16)[2]
            print(
                f"| {name}, {row} | {' | '.join(cells)} | {lost:.1f} % | {best:.2f} s |", flush=True
            )


def tile_table(size: tuple[int, int]) -> None:
    print("\n### Tiles of pixels (Laine et al. 2011, 4.1): STE in percent, dual_space\n")
    print("| scene | 1 x 1 | 2 x 2 | 4 x 4 |\n|---|---|---|---|", flush=True)
    for name in SCENES:
        for row in ("motion", "defocus", "both"):
            of = variants(name)[row]
            cells = [measure(of, size, cull="dual_space", cull_tile=n, samples=16)[0]
                     for n in (1, 2, 4)]  # fmt: skip
            print(f"| {name}, {row} | {' | '.join(f'{c:.2f}' for c in cells)} |", flush=True)


def quality_table(size: tuple[int, int]) -> None:
    print("\n### Image quality of InterleaveUVT (Laine et al. 2011, figure 1): RMSE, city, both\n")
    of = variants("city")["both"]

    def film(samples: int, **values: object) -> np.ndarray:
        settings = mb.Settings(method="stochastic", samples=samples, **values)  # type: ignore[arg-type]
        return mb.render(of, width=size[0], height=size[1], settings=settings).rgba

    films = [mb.render(of, width=size[0], height=size[1],
                       settings=mb.Settings(samples=64, pattern="sobol", seed=k)).rgba
             for k in range(2)]  # fmt: skip
    truth = np.mean(films, axis=0)
    print("| samples | interleave_uvt | sobol | jittered | random |\n|---|---|---|---|---|")
    for samples in (4, 16, 64):
        patterns = ("interleave_uvt", "sobol", "jittered", "random")
        errors = [np.sqrt(np.mean((film(samples, pattern=p) - truth) ** 2)) for p in patterns]
        print(f"| {samples} | {' | '.join(f'{e:.4f}' for e in errors)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="240 x 135 pixels")
    size = (240, 135) if parser.parse_args().quick else (960, 540)
    laine_table(size)
    wu_table(size)
    tile_table(size)
    quality_table(size)


if __name__ == "__main__":
    main()
