# SPDX-License-Identifier: GPL-3.0-or-later
"""3D Slicer's way from a NIfTI file to an STL file, in VTK alone: `python -m benchmarks.slicer_recipe IN OUT ...`.

Steps and numbers of vtkBinaryLabelmapToClosedSurfaceConversionRule: the segment's own box with an empty sample around
it; discrete flying edges; vtkDecimatePro where asked for; windowed sinc in 20 rounds; normals. The points are in
the file's spacing, without its orientation. `--bare` is VTK's shortest way: flying edges on the gray values, normals.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import (
    vtkDecimatePro,
    vtkFlyingEdges3D,
    vtkPolyDataNormals,
    vtkWindowedSincPolyDataFilter,
)
from vtkmodules.vtkFiltersGeneral import vtkDiscreteFlyingEdges3D
from vtkmodules.vtkIOGeometry import vtkSTLWriter
from vtkmodules.vtkIOImage import vtkNIFTIImageReader

ROUNDS, FACTOR = 20, 0.5  # Smoothing rounds and factor, Slicer's defaults.


def main() -> None:
    """Read, mesh, write, and print the number of triangles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source")
    parser.add_argument("target")
    inside = parser.add_mutually_exclusive_group(required=True)
    inside.add_argument("--label", type=int)
    inside.add_argument("--threshold", type=float)
    parser.add_argument("--decimate", type=float, default=0.0)
    parser.add_argument("--bare", action="store_true")
    asked = parser.parse_args()
    reader = vtkNIFTIImageReader()
    reader.SetFileName(asked.source)
    reader.Update()
    image = reader.GetOutput()
    if asked.bare:
        edges = vtkFlyingEdges3D()
        edges.SetInputData(image)
        edges.SetValue(0, asked.threshold)
        edges.ComputeScalarsOff()
        edges.ComputeGradientsOff()
        edges.ComputeNormalsOn()
        last = edges
    else:
        last = closed_surface(segment(image, asked.label, asked.threshold), asked.decimate)
    writer = vtkSTLWriter()
    writer.SetInputConnection(last.GetOutputPort())
    writer.SetFileName(asked.target)
    writer.SetFileTypeToBinary()
    writer.Write()
    print(last.GetOutput().GetNumberOfPolys())


def segment(image: Any, label: int | None, threshold: float | None) -> Any:
    """Return 0 and 1 in the box of the segment, with an empty sample around it."""
    values = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(image.GetDimensions()[::-1])
    mask = values == label if threshold is None else values >= threshold
    ends = [np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    box = tuple(slice(int(at[0]), int(at[-1]) + 1) for at in ends)
    padded = np.pad(mask[box].view(np.uint8), 1)
    cropped = vtkImageData()
    cropped.SetDimensions(padded.shape[::-1])
    cropped.SetSpacing(image.GetSpacing())
    cropped.SetOrigin(*(side * (at.start - 1) for side, at in zip(image.GetSpacing(), box[::-1], strict=True)))
    cropped.GetPointData().SetScalars(numpy_to_vtk(padded.ravel(), deep=True))
    return cropped


def closed_surface(binary: Any, decimate: float) -> Any:
    """Run the filters and return the last one."""
    edges = vtkDiscreteFlyingEdges3D()
    edges.SetInputData(binary)
    edges.SetValue(0, 1)
    edges.ComputeGradientsOff()
    edges.ComputeNormalsOff()
    edges.ComputeScalarsOff()
    before = edges
    if decimate > 0:
        before = vtkDecimatePro()
        before.SetInputConnection(edges.GetOutputPort())
        before.SetFeatureAngle(60)
        before.SplittingOff()
        before.PreserveTopologyOn()
        before.SetMaximumError(1)
        before.SetTargetReduction(decimate)
    smoother = vtkWindowedSincPolyDataFilter()
    smoother.SetInputConnection(before.GetOutputPort())
    smoother.SetNumberOfIterations(ROUNDS)
    smoother.SetPassBand(10.0 ** (-4.0 * FACTOR))
    smoother.BoundarySmoothingOff()
    smoother.FeatureEdgeSmoothingOff()
    smoother.NonManifoldSmoothingOn()
    smoother.NormalizeCoordinatesOn()
    normals = vtkPolyDataNormals()
    normals.SetInputConnection(smoother.GetOutputPort())
    normals.ConsistencyOn()
    normals.SplittingOff()
    return normals


if __name__ == "__main__":
    main()
