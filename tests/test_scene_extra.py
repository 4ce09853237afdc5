"""The models and benchmarks that lie beside a checkout of the maintainers.

Extra: they are not part of the repository, so these tests exist only where the files do. What they
check is covered by files that the other tests make.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbinterval as mb
from mbinterval.scene.exposure import expose
from mbinterval.scene.load import load

SHARED = Path(__file__).parents[2] / "shared"
KINDS = (".glb", ".gltf", ".obj", ".ply", ".usd", ".usda", ".usdc", ".usdz")
REFUSED = {"computeAtTime.usda": "holds no mesh, only Cube"}
FRAMES = {"blendshapes.usda": 20.0}  # a flat mesh, seen edge-on until it turns
MODELS = sorted(p for p in SHARED.glob("assets/*/*") if p.suffix in KINDS)
BENCHMARKS = sorted(p for p in SHARED.glob("benchmark/*.npz") if "reference" not in p.name)

if MODELS:

    @pytest.mark.parametrize("path", MODELS, ids=lambda path: path.name)
    def test_model(path):
        """Every model is rendered as ``mbinterval render MODEL`` would, or says why not."""
        if path.name in REFUSED:
            with pytest.raises(mb.SceneError, match=REFUSED[path.name]):
                mb.load(path)
            return
        scene = mb.load(path)
        frame = FRAMES.get(path.name, 3.0)
        exposure = expose(scene, frame, 4 / 3)
        assert exposure.meshes
        assert any(np.ptp(mesh.positions) > 0 for mesh in exposure.meshes)
        film = mb.render(scene, frame=frame, width=64, height=48, settings=mb.Settings(samples=1))
        assert np.isfinite(film.rgba).all()
        assert film.rgba[..., 3].max() > 0.0


if BENCHMARKS:

    @pytest.mark.parametrize("path", BENCHMARKS, ids=lambda path: path.name)
    def test_benchmark(path):
        (mesh,) = expose(load(path), 0.0, 4 / 3).meshes
        with np.load(path) as stored:
            np.testing.assert_array_equal(mesh.positions[0], stored["V0"])
            np.testing.assert_array_equal(mesh.positions[1], stored["V1"])
            np.testing.assert_array_equal(mesh.face_color, stored["C"])
