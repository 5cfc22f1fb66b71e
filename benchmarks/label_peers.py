# SPDX-License-Identifier: GPL-3.0-or-later
"""The peers' ways from a label to a surface, and how far a surface is from the true one."""

from __future__ import annotations

from typing import Any

import mcubes
import numpy as np
import vtk
from numpy.typing import NDArray
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

from .label_bodies import Labelled

Mesh = tuple[NDArray[Any], NDArray[Any]]


def image_of(mask: NDArray[np.bool_], spacing: tuple[float, float, float] = (1, 1, 1)) -> vtk.vtkImageData:
    """Return a mask with an empty sample all around, its first sample at 0."""
    padded = np.pad(mask.astype(np.uint8), 1)
    image = vtk.vtkImageData()
    image.SetDimensions(padded.shape[::-1])
    image.SetSpacing(spacing)
    image.SetOrigin(*(-side for side in spacing))
    image.GetPointData().SetScalars(numpy_to_vtk(padded.ravel(), deep=True))
    return image


def poly_of(mesh: Mesh) -> vtk.vtkPolyData:
    vertices, faces = mesh
    poly, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(vertices, np.float64), deep=True))
    cells.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(faces, np.int64).ravel(), deep=True))
    poly.SetPoints(points)
    poly.SetPolys(cells)
    return poly


def mesh_of(poly: vtk.vtkPolyData) -> Mesh:
    triangles = vtk.vtkTriangleFilter()
    triangles.SetInputData(poly)
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.Update()
    poly = triangles.GetOutput()
    return vtk_to_numpy(poly.GetPoints().GetData()).astype(float), vtk_to_numpy(
        poly.GetPolys().GetConnectivityArray()
    ).reshape(-1, 3)


def moved(mesh: Mesh, affine: NDArray[np.float64]) -> Mesh:
    return mesh[0] @ affine[:3, :3].T + affine[:3, 3], mesh[1]


def spacing_of(affine: NDArray[np.float64]) -> tuple[float, float, float]:
    return tuple(float(s) for s in np.sqrt((affine[:3, :3] ** 2).sum(axis=0)))  # type: ignore[return-value]


def cubes(mask: NDArray[np.bool_]) -> vtk.vtkPolyData:
    edges = vtk.vtkDiscreteFlyingEdges3D()
    edges.SetInputData(image_of(mask))
    edges.ComputeNormalsOff()
    edges.ComputeGradientsOff()
    edges.SetValue(0, 1)
    edges.Update()
    return edges.GetOutput()


def slicer(mask: NDArray[np.bool_], affine: NDArray[np.float64], factor: float) -> Mesh:
    """Make a closed surface of a binary label map as 3D Slicer does: windowed sinc in index space."""
    smoother = vtk.vtkWindowedSincPolyDataFilter()
    smoother.SetInputData(cubes(mask))
    smoother.SetNumberOfIterations(20)
    smoother.SetPassBand(10.0 ** (-4.0 * factor))
    smoother.BoundarySmoothingOff()
    smoother.FeatureEdgeSmoothingOff()
    smoother.NonManifoldSmoothingOn()
    smoother.NormalizeCoordinatesOn()
    smoother.Update()
    return moved(mesh_of(smoother.GetOutput()), affine)


def surface_nets(mask: NDArray[np.bool_], affine: NDArray[np.float64]) -> Mesh:
    spacing = spacing_of(affine)
    nets = vtk.vtkSurfaceNets3D()
    nets.SetInputData(image_of(mask, spacing))
    nets.SetValue(0, 1)
    nets.Update()
    vertices, faces = mesh_of(nets.GetOutput())
    return moved((vertices / spacing, faces), affine)


def pymcubes(mask: NDArray[np.bool_], affine: NDArray[np.float64]) -> Mesh:
    field = mcubes.smooth_constrained(np.pad(mask, 3))
    vertices, faces = mcubes.marching_cubes(field, 0)
    return moved((vertices[:, ::-1] - 3, faces[:, ::-1].astype(np.int64)), affine)


def taubin(mask: NDArray[np.bool_], affine: NDArray[np.float64], rounds: int = 30) -> Mesh:
    """Smooth by Taubin's lambda and mu, umbrella weights, in mm."""
    vertices, faces = moved(mesh_of(cubes(mask)), affine)
    a, b = np.concatenate([faces, faces[:, ::-1]])[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).T
    pairs = np.unique(a.astype(np.int64) * len(vertices) + b)
    a, b = np.divmod(pairs, len(vertices))
    count = np.bincount(a, minlength=len(vertices))[:, None]
    for _ in range(rounds):
        for step in (0.5, -0.53):
            mean = np.stack([np.bincount(a, vertices[b, axis], len(vertices)) for axis in range(3)], axis=1) / count
            vertices = vertices + step * (mean - vertices)
    return vertices, faces


PEERS = {
    "Slicer 0.3": lambda mask, affine: slicer(mask, affine, 0.3),
    "Slicer 0.5": lambda mask, affine: slicer(mask, affine, 0.5),
    "Slicer 0.7": lambda mask, affine: slicer(mask, affine, 0.7),
    "SurfaceNets3D": surface_nets,
    "PyMCubes": pymcubes,
    "Taubin": taubin,
}


def enclosed(mesh: Mesh) -> float:
    corners = (mesh[0] - mesh[0].mean(axis=0))[mesh[1]]
    return float((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


def vertex_normals(mesh: Mesh) -> NDArray[np.float64]:
    vertices, faces = mesh
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.stack(
        [np.bincount(faces.T.ravel(), np.tile(cross[:, axis], 3), len(vertices)) for axis in range(3)], axis=1
    )
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def points_on(mesh: Mesh, number: int = 30000) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.float64]]:
    """Return random points spread evenly over the surface, their faces and their weights at the corners."""
    random = np.random.default_rng(0)
    corners = mesh[0][mesh[1]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    face = random.choice(len(area), number, p=area / area.sum())
    u, v = random.random((2, number))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=1)
    return (corners[face] * weights[:, :, None]).sum(axis=1), face, weights


def distance(points: NDArray[np.float64], mesh: Mesh) -> NDArray[np.float64]:
    far = vtk.vtkImplicitPolyDataDistance()
    far.SetInput(poly_of(mesh))
    out = vtk.vtkDoubleArray()
    far.EvaluateFunction(numpy_to_vtk(np.ascontiguousarray(points), deep=True), out)
    return np.abs(vtk_to_numpy(out))


def compared(mesh: Mesh, case: Labelled) -> dict[str, float]:
    """Return mean and 95 % distance both ways, mm; volume error to the label, %; mean angle of normals, degrees."""
    from scipy.spatial import cKDTree

    true = (case.vertices, case.faces)
    points, face, weights = points_on(mesh)
    there = distance(points, true)
    back = distance(points_on(true)[0], mesh)
    both = np.concatenate([there, back])
    normals = (vertex_normals(mesh)[mesh[1][face]] * weights[:, :, None]).sum(axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    _, nearest = cKDTree(case.vertices).query(points)
    turn = (normals * vertex_normals(true)[nearest]).sum(axis=1)
    voxels = case.mask.sum() * abs(np.linalg.det(case.affine[:3, :3]))
    return {
        "mean": float((there.mean() + back.mean()) / 2),
        "p95": float(np.percentile(both, 95)),
        "volume": 100 * (enclosed(mesh) / voxels - 1),
        "angle": float(np.rad2deg(np.arccos(np.clip(turn, -1, 1))).mean()),
    }
