# SPDX-License-Identifier: GPL-3.0-or-later
"""Extraction against VTK, scikit-image and PyMCubes; strides against stride 1; memory; distance from the limit."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.extraction.grid import make_grid
from ctmc_addon.core.extraction.marching_cubes import Counts, count_steps, extract_steps, marching_cubes
from ctmc_addon.core.machine.budget import Budget
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh
from ctmc_addon.core.planning.cost_estimate import FieldCache, cost_estimate_steps
from ctmc_addon.core.planning.rates import ADDING, CALIBRATION, COMPARING, MEASURING
from ctmc_addon.core.progress import finish
from ctmc_addon.core.settings import ReconstructionSettings
from ctmc_addon.core.surfaces.make import reconstruct
from ctmc_addon.core.volume.volume import Volume

from . import peers, scenes
from .measuring import Row, Session, bandwidth, least_seconds, peak_bytes, stage_seconds

VTK = "vtkFlyingEdges3D"
STRIDES = {(2, 2, 1): 0.39, (3, 3, 1): 0.21}  # Share of the time at stride 1: 61 % and 79 % saved.
PREVIEW_MS = 100


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    sparse = scenes.tumors()
    work = f"extraction, sparse, {sized(sparse, scenes.EDGE)}"
    against_vtk(session, work, sparse, scenes.EDGE, False, {1: 0.35, 2: 0.35, None: 0.33})
    against_vtk(session, f"{work}, normals", sparse, scenes.EDGE, True, {1: None, 2: None, None: None})
    session.compare(
        work,
        lambda: marching_cubes(sparse, scenes.EDGE, normals=False),
        {
            "scikit-image": (peers.scikit_image(sparse, scenes.EDGE), 0.04),
            "PyMCubes": (peers.pymcubes(sparse, scenes.EDGE), None),
        },
        note="CTMC with its usual threads; scikit-image always makes normals",
        repeats=max(1, session.repeats // 2),
    )
    memory(session, "sparse", sparse, scenes.EDGE, 0.25)

    dense = scenes.abdomen(session.scratch)
    work = f"extraction, dense, {sized(dense, scenes.DENSE_THRESHOLD)}"
    against_vtk(session, work, dense, scenes.DENSE_THRESHOLD, False, {1: 0.75, 2: 0.75, None: 0.5})
    against_vtk(session, f"{work}, normals", dense, scenes.DENSE_THRESHOLD, True, {1: 1.0, 2: 1.0, None: None})
    memory(session, "dense", dense, scenes.DENSE_THRESHOLD, None)

    widths = {threads: bandwidth(session, threads) for threads in session.threads}
    session.facts["bandwidth"] = widths
    strides(session, "sparse", sparse, scenes.EDGE, widths[session.threads[-1]])
    strides(session, "dense", dense, scenes.DENSE_THRESHOLD, widths[session.threads[-1]])
    few = np.ascontiguousarray(dense[:: dense.shape[0] // 29][:29])
    strides(session, "29 slices", few, scenes.DENSE_THRESHOLD, widths[session.threads[-1]])
    session.facts["stages"] = {
        f"{name}, {threads} thread{'s' if threads > 1 else ''}": stages(session, values, at, threads, widths[threads])
        for name, values, at in (("sparse", sparse, scenes.EDGE), ("dense", dense, scenes.DENSE_THRESHOLD))
        for threads in session.threads
    }
    preview(session, sparse, dense)
    if not session.shared:  # the prediction is of elapsed time
        predicted(session, sparse, dense)


def sized(values: NDArray[Any], threshold: float) -> str:
    """Return sizes as text, such as `512 x 512 x 250 uint8, 240k triangles`."""
    slices, rows, columns = values.shape
    faces = counted(values, threshold).faces
    size = f"{faces / 1e6:.2f}M" if faces >= 1e6 else f"{faces / 1e3:.0f}k"
    return f"{columns} x {rows} x {slices} {values.dtype}, {size} triangles"


def counted(values: NDArray[Any], threshold: float, stride: tuple[int, int, int] = (1, 1, 1)) -> Counts:
    """Return the exact counts of a surface."""
    return finish(count_steps(make_grid(values, stride), threshold))


def against_vtk(
    session: Session,
    work: str,
    values: NDArray[Any],
    threshold: float,
    normals: bool,
    targets: dict[int | None, float | None],
) -> None:
    """Race VTK with this many threads each; None runs both as installed: CTMC with all it uses, VTK with one."""
    for threads, target in targets.items():
        if session.shared and threads != 1:
            continue
        how = "as installed" if threads is None else f"{threads} thread{'s' if threads > 1 else ''} each"
        session.compare(
            work,
            lambda threads=threads: marching_cubes(values, threshold, normals=normals, threads=threads),
            {f"{VTK}, {how}": (peers.flying_edges(values, threshold, normals, threads), target)},
        )


def memory(session: Session, name: str, values: NDArray[Any], threshold: float, target: float | None) -> None:
    """Measure the most memory that a call holds in addition to its result."""
    peak = peak_bytes(lambda: marching_cubes(values, threshold, normals=False), mesh_bytes)
    session.add(
        Row(
            session.part,
            f"extraction, {name}: memory beside the result",
            "size of the volume",
            peak / 2**20,
            values.nbytes / 2**20,
            target,
            unit="MiB",
        )
    )


def mesh_bytes(mesh: TriangleMesh) -> int:
    """Return the bytes of a mesh."""
    return sum(array.nbytes for array in (mesh.vertices, mesh.faces, mesh.normals) if array is not None)


def strides(session: Session, name: str, values: NDArray[Any], threshold: float, width: dict[str, float]) -> None:
    """Measure strides of 2 x 2 and 3 x 3 pixels, and the bound by memory bandwidth."""
    sides = {(1, 1, 1): None, **STRIDES}
    seconds = session.race(
        {
            str(stride): lambda stride=stride: marching_cubes(values, threshold, stride, normals=False)
            for stride in sides
        }
    )
    least = {stride: least_at(values, threshold, stride, width) for stride in sides}
    for stride, target in STRIDES.items():
        runs = {name: seconds[name] for name in (str(stride), str((1, 1, 1)))}
        ours, whole = (session.typical(taken) for taken in runs.values())
        limit = least[stride] / least[(1, 1, 1)]
        session.add(
            Row(
                session.part,
                f"extraction, {name}, stride {stride[0]} x {stride[1]}",
                "CTMC at stride 1",
                ours,
                whole,
                target,
                note=f"saves {1 - ours / whole:.0%}; the bytes allow {1 - limit:.0%}",
                runs=runs,
            )
        )


def least_at(values: NDArray[Any], threshold: float, stride: tuple[int, int, int], width: dict[str, float]) -> float:
    """Return the seconds to read the needed rows and write the result at this machine's bandwidth.

    Memory comes in lines of 64 bytes: of a row that holds samples all is read, up to strides of a line.
    """
    read = values.nbytes / stride[1] / stride[2] / max(1, stride[0] * values.itemsize / 64)
    counts = counted(values, threshold, stride)
    return least_seconds(read, 12 * (counts.vertices + counts.faces), width)


def stages(
    session: Session, values: NDArray[Any], threshold: float, threads: int, width: dict[str, float]
) -> list[dict[str, Any]]:
    """Return for each extraction stage its seconds, the least bytes to read and write, and their seconds."""
    grid = make_grid(values)
    seconds = stage_seconds(session, lambda: extract_steps(grid, threshold, False, Budget(threads)))
    counts = finish(count_steps(grid, threshold))
    bits = values.size / 8
    case_bytes = 5 * counts.active  # of every active voxel its place (int32) and its case
    moved = {
        "Comparing with the threshold": (values.nbytes, bits),
        "Finding active voxels": (bits, case_bytes),
        # Two values for every vertex; written are both ends of alpha and the triangles, 12 bytes each.
        "Placing vertices and triangles": (
            case_bytes + 2 * values.itemsize * counts.vertices,
            24 * counts.vertices + 12 * counts.faces,
        ),
    }
    rows = []
    for stage, taken in seconds.items():
        if taken < 1e-4:  # the last sign of life
            continue
        read, written = moved.get(stage, (None, None))
        least = None if read is None else least_seconds(read, written, width)
        rows.append({"stage": stage, "seconds": taken, "read": read, "written": written, "least_seconds": least})
    return rows


def preview(session: Session, sparse: NDArray[Any], dense: NDArray[Any]) -> None:
    """Measure a coarse surface after a threshold change: counted, then extracted without normals."""
    stride = (4, 4, 2)
    for name, values, threshold in (("sparse", sparse, scenes.EDGE), ("dense", dense, scenes.DENSE_THRESHOLD)):

        def call(values: NDArray[Any] = values, threshold: float = threshold) -> Any:
            grid = make_grid(values, stride)
            finish(count_steps(grid, threshold))
            return finish(extract_steps(grid, threshold, normals=False))

        session.add(
            Row(
                session.part,
                f"preview, {name}, threshold changed: count and extract at stride {' x '.join(map(str, stride))}",
                f"{PREVIEW_MS} ms",
                session.seconds(call),
                PREVIEW_MS / 1000,
                1.0,
            )
        )


def predicted(session: Session, sparse: NDArray[Any], dense: NDArray[Any]) -> None:
    """Compare the seconds that the panel predicts with those of a reconstruction, without handing over to Blender."""
    cases: dict[str, tuple[NDArray[Any], dict[str, Any]]] = {
        "sparse": (sparse, {"threshold": scenes.EDGE}),
        "sparse, 90 % removed": (sparse, {"threshold": scenes.EDGE, "simplifier": "builtin", "reduction": 0.9}),
        "sparse, 3 x 3, within 0.5 mm": (
            sparse,
            {"threshold": scenes.EDGE, "stride": (3, 3, 1), "simplifier": "builtin", "max_error_mm": 0.5},
        ),
        "dense": (dense, {"threshold": scenes.DENSE_THRESHOLD}),
        "dense, 2 x 2": (dense, {"threshold": scenes.DENSE_THRESHOLD, "stride": (2, 2, 1)}),
    }
    for name, (values, chosen) in cases.items():
        volume, settings = Volume(values, np.eye(4)), ReconstructionSettings(**chosen)
        estimate = finish(cost_estimate_steps(FieldCache(volume), settings))
        stages = CALIBRATION.stage_seconds([estimate]).items()
        estimated = sum(seconds for (_, stage), seconds in stages if stage not in (MEASURING, COMPARING, ADDING))
        took = session.seconds(partial(reconstruct, volume, settings), 3)
        session.add(
            Row(
                session.part,
                f"predicted, {name}: {estimated:.2g} s, taken {took:.2g} s",
                "the shorter of both",
                max(estimated, took),
                min(estimated, took),
                2.0,
            )
        )
