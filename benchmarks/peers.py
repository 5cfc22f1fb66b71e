# SPDX-License-Identifier: GPL-3.0-or-later
"""The others, called as their users call them; each import stands where it is needed.

VTK gets the volume as vtkImageData without a copy, scalars off, and is timed for `Update` alone: what its
users must still do to have NumPy arrays is not counted.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh

PACKAGES = (
    *("numpy", "vtk", "scikit-image", "PyMCubes", "fast-simplification", "pyfqmr", "meshoptimizer", "SimpleITK"),
    *("libigl", "trimesh", "manifold3d"),
)


def versions() -> dict[str, str]:
    """Return the installed versions of the peers."""
    installed = {}
    for name in (*PACKAGES, "bpy"):
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            installed[name] = "missing"
    return installed


def vtk_threads(count: int | None) -> None:
    """Set the threads of VTK; None for its wheel's default."""
    from vtkmodules.vtkCommonCore import vtkSMPTools

    vtkSMPTools.SetBackend("Sequential" if count is None else "STDThread")
    vtkSMPTools.Initialize(count or 0)


def vtk_image(values: NDArray[Any]) -> Any:
    """Return the volume as a VTK image that shares its memory."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    image.SetDimensions(*values.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(values.reshape(-1)))
    return image


def flying_edges(values: NDArray[Any], threshold: float, normals: bool, threads: int | None) -> Callable[[], Any]:
    """Return a call that extracts with vtkFlyingEdges3D."""
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    image = vtk_image(values)

    def call() -> Any:
        vtk_threads(threads)
        contour = vtkFlyingEdges3D()
        contour.SetInputData(image)
        contour.SetValue(0, threshold)
        contour.SetComputeScalars(False)
        contour.SetComputeGradients(False)
        contour.SetComputeNormals(normals)
        contour.Update()
        return contour.GetOutput()

    return call


def openvdb(values: NDArray[Any], threshold: float) -> Callable[[], Any] | None:
    """Return a call that meshes with Blender's own OpenVDB; None if Blender lacks the module.

    The volume is a dense grid whose background is its lowest value, filled before, as in a Volume object of Blender.
    """
    from ctmc_addon.blender.volume.vdb import vdb_writer

    module = vdb_writer()
    if module is None:
        return None
    grid = module.FloatGrid(float(values.min()))
    grid.copyFromArray(np.ascontiguousarray(values.transpose(2, 1, 0), np.float32))
    return lambda: grid.convertToPolygons(threshold)


def scikit_image(values: NDArray[Any], threshold: float) -> Callable[[], Any]:
    """Return a call that extracts with skimage.measure.marching_cubes, which always makes normals."""
    from skimage.measure import marching_cubes

    return lambda: marching_cubes(values, threshold)


def pymcubes(values: NDArray[Any], threshold: float) -> Callable[[], Any]:
    """Return a call that extracts with PyMCubes."""
    import mcubes

    return lambda: mcubes.marching_cubes(values, threshold)


def vtk_polydata(mesh: TriangleMesh) -> Any:
    """Return a mesh as VTK polydata."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    points, cells, data = vtkPoints(), vtkCellArray(), vtkPolyData()
    points.SetData(numpy_to_vtk(mesh.vertices, deep=True))
    offsets = np.arange(0, mesh.faces.size + 1, 3, dtype=np.int64)
    corners = mesh.faces.astype(np.int64).ravel()
    cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(corners, deep=True))
    data.SetPoints(points)
    data.SetPolys(cells)
    return data


def from_polydata(data: Any) -> TriangleMesh:
    """Return the mesh of VTK polydata."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    vertices = vtk_to_numpy(data.GetPoints().GetData()).astype(np.float32)
    faces = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int32)
    return TriangleMesh(vertices, faces)


def libigl_distance(mesh: TriangleMesh) -> Callable[[NDArray[np.float64]], Any]:
    """Return a call for signed distances by libigl, with one thread if it is the first use of libigl."""
    os.environ["IGL_NUM_THREADS"] = "1"
    import igl

    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
    kind = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    return lambda points: igl.signed_distance(points, vertices, faces, sign_type=kind)[0]


def vtk_distance(mesh: TriangleMesh) -> Callable[[NDArray[np.float64]], Any]:
    """Return a call for signed distances by vtkImplicitPolyDataDistance, which PyVista calls too."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkDoubleArray
    from vtkmodules.vtkFiltersCore import vtkImplicitPolyDataDistance

    function = vtkImplicitPolyDataDistance()
    function.SetInput(vtk_polydata(mesh))

    def call(points: NDArray[np.float64]) -> Any:
        out = vtkDoubleArray()
        function.FunctionValue(numpy_to_vtk(np.ascontiguousarray(points)), out)
        return vtk_to_numpy(out)

    return call


def trimesh_distance(mesh: TriangleMesh) -> Callable[[NDArray[np.float64]], Any]:
    """Return a call for unsigned distances by trimesh."""
    import trimesh

    query = trimesh.proximity.ProximityQuery(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    return lambda points: query.on_surface(points)[1]


def quadric_decimation(mesh: TriangleMesh, reduction: float) -> Callable[[], TriangleMesh]:
    """Return a call that simplifies with vtkQuadricDecimation."""
    from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

    data = vtk_polydata(mesh)

    def call() -> TriangleMesh:
        decimation = vtkQuadricDecimation()
        decimation.SetInputData(data)
        decimation.SetTargetReduction(reduction)
        decimation.Update()
        return from_polydata(decimation.GetOutput())  # a copy: about a hundredth of the whole

    return call


def fast_simplification(mesh: TriangleMesh, reduction: float) -> Callable[[], TriangleMesh]:
    """Return a call that simplifies with fast-simplification."""
    import fast_simplification as library

    return lambda: TriangleMesh(*library.simplify(mesh.vertices, mesh.faces, reduction))


def pyfqmr(mesh: TriangleMesh, reduction: float) -> Callable[[], TriangleMesh]:
    """Return a call that simplifies with pyfqmr."""
    import pyfqmr as library

    def call() -> TriangleMesh:
        simplifier = library.Simplify()
        simplifier.setMesh(mesh.vertices, mesh.faces)
        simplifier.simplify_mesh(target_count=round(len(mesh.faces) * (1 - reduction)), verbose=False)
        vertices, faces, _ = simplifier.getMesh()
        return TriangleMesh(vertices.astype(np.float32), faces.astype(np.int32))

    return call


def meshoptimizer(mesh: TriangleMesh, reduction: float) -> Callable[[], TriangleMesh]:
    """Return a call that simplifies with meshoptimizer, which does not move vertices."""
    import meshoptimizer as library

    indices = mesh.faces.astype(np.uint32).ravel()

    def call() -> TriangleMesh:
        out = np.empty_like(indices)
        target = 3 * round(len(mesh.faces) * (1 - reduction))
        count = library.simplify(out, indices, mesh.vertices, target_index_count=target, target_error=1.0)
        return TriangleMesh(mesh.vertices, out[:count].reshape(-1, 3).astype(np.int32))

    return call


def trimesh_spheres(mesh: TriangleMesh, faces: NDArray[Any]) -> Callable[[], NDArray[np.float64]]:
    """Return a call of trimesh's largest tangent spheres inside, at the centers of some faces; its trees are ready.

    At a vertex the triangles around cut into every sphere, and its method finds almost none.
    """
    import trimesh

    body = trimesh.Trimesh(mesh.vertices.astype(np.float64), mesh.faces, process=False)
    points, normals = body.triangles_center[faces], body.face_normals[faces]
    trimesh.proximity.thickness(body, points[:1], normals=normals[:1])
    return lambda: trimesh.proximity.thickness(body, points, normals=normals)


def trimesh_rays(mesh: TriangleMesh, vertices: NDArray[Any]) -> Callable[[], NDArray[np.float64]]:
    """Return a call of trimesh's thickness by a ray along the normal (Embree), at some vertices; its tree is ready."""
    import trimesh

    body = trimesh.Trimesh(mesh.vertices.astype(np.float64), mesh.faces, process=False)
    points, normals = mesh.vertices[vertices].astype(np.float64), mesh.normals[vertices].astype(np.float64)
    trimesh.proximity.thickness(body, points[:1], normals=normals[:1], method="ray")
    return lambda: trimesh.proximity.thickness(body, points, normals=normals, method="ray")


def shape_diameter(mesh: TriangleMesh, vertices: NDArray[Any], rays: int = 30) -> Callable[[], NDArray[np.float64]]:
    """Return a call of libigl's shape diameter at some vertices, in one thread."""
    os.environ["IGL_NUM_THREADS"] = "1"
    import igl

    corners, faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
    points, normals = mesh.vertices[vertices].astype(np.float64), mesh.normals[vertices].astype(np.float64)
    return lambda: igl.shape_diameter_function(corners, faces, points, normals, rays)
