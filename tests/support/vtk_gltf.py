"""Vertices of a glTF file as VTK's reader evaluates them: an oracle that is not ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def vtk_positions(path: Path, seconds: float, clip: int = 0) -> list[np.ndarray]:
    """World positions of every primitive, in float32, ``(N, 3)`` each, in the order of the file."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkMultiBlockDataSet
    from vtkmodules.vtkIOGeometry import vtkGLTFReader

    reader = vtkGLTFReader()
    reader.SetFileName(str(path.resolve()))  # with ".." in it the reader animates nothing
    reader.ApplyDeformationsToGeometryOn()
    reader.SetFrameRate(60)
    reader.UpdateInformation()
    for index in range(reader.GetNumberOfAnimations()):
        enable = reader.EnableAnimation if index == clip else reader.DisableAnimation
        enable(index)
    reader.UpdateTimeStep(seconds)
    found: list[np.ndarray] = []

    def walk(block: object) -> None:
        if isinstance(block, vtkMultiBlockDataSet):
            for index in range(block.GetNumberOfBlocks()):
                walk(block.GetBlock(index))
        elif block is not None:
            found.append(np.array(vtk_to_numpy(block.GetPoints().GetData())))

    walk(reader.GetOutput())
    return found
