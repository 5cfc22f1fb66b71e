# SPDX-License-Identifier: GPL-3.0-or-later
"""How cost grows: time and memory over volume size, triangles, threads and stride, with VTK beside it.

A ball that fills a cube has triangles that grow with the square of the side while the volume grows with
its cube; balls in a cube of one size change the triangles alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.extraction.grid import make_grid
from ctmc_addon.core.extraction.marching_cubes import count_steps, marching_cubes
from ctmc_addon.core.progress import finish

from . import peers, scenes
from .extraction import mesh_bytes
from .measuring import Session, peak_bytes

SIZES = (64, 96, 128, 192, 256, 384, 512)
ACROSS = (1, 2, 4, 6, 8)  # Balls along a side of the cube.
CUBE = 320
STRIDES = (1, 2, 3, 4, 6, 8)


def measure(session: Session) -> None:
    """Measure four series of points; they have no targets, so no rows."""
    session.facts["size"] = [point(session, scenes.ball(size), 1) | {"side": size} for size in SIZES]
    session.say("growth over size measured")
    balls = {across: scenes.spheres(CUBE, across, 0.4 * CUBE / across) for across in ACROSS}
    session.facts["triangles"] = [point(session, values, 1) | {"across": count} for count, values in balls.items()]
    session.say("growth over triangles measured")
    dense = scenes.abdomen(session.scratch)
    sparse = scenes.tumors()
    session.facts["threads"] = [
        threads_point(session, name, values, at, threads)
        for name, values, at in (("sparse", sparse, scenes.EDGE), ("dense", dense, scenes.DENSE_THRESHOLD))
        for threads in session.threads
    ]
    session.facts["stride"] = [stride_point(session, dense, stride) for stride in STRIDES]
    session.facts["summary"] = summary(session.facts)
    for sentence in session.facts["summary"]:
        session.say(sentence)


def point(session: Session, values: NDArray[np.uint8], threads: int) -> dict[str, Any]:
    """Return seconds, peak memory and counts of one volume; VTK with as many threads."""
    counts = finish(count_steps(make_grid(values), scenes.EDGE))
    calls = {
        "seconds": lambda: marching_cubes(values, scenes.EDGE, normals=False, threads=threads),
        "vtk_seconds": peers.flying_edges(values, scenes.EDGE, False, threads),
    }
    seconds = session.race(calls, session.repeats)
    peak = peak_bytes(calls["seconds"], mesh_bytes)
    return {
        "voxels": counts.voxels,
        "triangles": counts.faces,
        "bytes": values.nbytes,
        "peak_bytes": peak,
        "result_bytes": 12 * (counts.faces + counts.vertices),
        **{name: session.typical(taken) for name, taken in seconds.items()},
    }


def threads_point(session: Session, name: str, values: NDArray[Any], at: float, threads: int) -> dict[str, Any]:
    """Return seconds and peak memory of one volume with this many threads."""

    def call() -> Any:
        return marching_cubes(values, at, normals=False, threads=threads)

    seconds = session.race({"seconds": call, "vtk_seconds": peers.flying_edges(values, at, False, threads)})
    return {
        "scene": name,
        "threads": threads,
        "bytes": values.nbytes,
        "peak_bytes": peak_bytes(call, mesh_bytes),
        **{key: session.typical(taken) for key, taken in seconds.items()},
    }


def stride_point(session: Session, values: NDArray[Any], stride: int) -> dict[str, Any]:
    """Return seconds and peak memory at strides of `stride` x `stride` x 1 pixels."""
    sides = (stride, stride, 1)

    def call() -> Any:
        return marching_cubes(values, scenes.DENSE_THRESHOLD, sides, normals=False, threads=1)

    counts = finish(count_steps(make_grid(values, sides), scenes.DENSE_THRESHOLD))
    return {
        "stride": stride,
        "voxels": counts.voxels,
        "triangles": counts.faces,
        "bytes": values.nbytes,
        "peak_bytes": peak_bytes(call, mesh_bytes),
        "seconds": session.seconds(call),
    }


def summary(facts: dict[str, Any]) -> list[str]:
    """Test whether time is linear: one price per voxel and one per triangle for a whole series."""
    lines = []
    for series, name in (("size", "volume size"), ("triangles", "triangles"), ("stride", "stride")):
        price = prices(facts[series])
        worst = max(facts[series], key=lambda point: abs(departure(point, price)))
        lines.append(
            f"over {name}: {price[0] * 1e9:.2f} ns a voxel, {price[1] * 1e9:.0f} ns a triangle and "
            f"{price[2] * 1e3:.1f} ms; the farthest point is {departure(worst, price):+.0%} off"
        )
    return lines


def prices(points: list[dict[str, Any]]) -> NDArray[np.float64]:
    """Return seconds per voxel, triangle and call, not below zero, by least squares of relative errors."""
    visited = np.array([[point["voxels"], point["triangles"], 1.0] for point in points])
    visited /= np.array([[point["seconds"]] for point in points])
    best, least = np.zeros(3), np.inf
    for used in ([0, 1, 2], [0, 1], [1, 2], [0, 2], [0], [1]):
        solution = np.linalg.lstsq(visited[:, used], np.ones(len(points)), rcond=None)[0]
        rest = ((visited[:, used] @ solution - 1) ** 2).sum()
        if (solution >= 0).all() and rest < least:
            best, least = np.zeros(3), rest
            best[used] = solution
    return best


def departure(point: dict[str, Any], price: NDArray[np.float64]) -> float:
    """Return the relative deviation of the measured seconds from the fit."""
    return point["seconds"] / float(price @ [point["voxels"], point["triangles"], 1.0]) - 1
