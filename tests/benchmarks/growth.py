"""How cost grows: time and memory over volume size, triangles, threads and stride, with VTK beside it.

A ball that fills a cube has triangles that grow with the square of the side while the volume grows with
its cube; balls in a cube of one size change the triangles alone.
"""

from __future__ import annotations

import statistics
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.marching_cubes import count_steps, marching_cubes
from ctmc_addon.core.progress import finish
from ctmc_addon.core.sampling import make_grid

from . import peers, scenes
from .extraction import mesh_bytes
from .measuring import Session, peak_bytes

SIZES = (64, 96, 128, 192, 256, 384, 512)
ACROSS = (1, 2, 4, 6, 8)  # balls along a side of the cube
CUBE = 320
STRIDES = (1, 2, 3, 4, 6, 8)


def measure(session: Session) -> None:
    """Four series of points; no rows, as nobody promised them."""
    session.facts["size"] = [point(session, scenes.ball(size), 1) | {"side": size} for size in SIZES]
    session.say("growth over size measured")
    balls = {across: scenes.spheres(CUBE, across, 0.4 * CUBE / across) for across in ACROSS}
    session.facts["triangles"] = [point(session, values, 1) | {"across": count} for count, values in balls.items()]
    session.say("growth over triangles measured")
    dense = scenes.abdomen(session.scratch)
    sparse = scenes.tumours()
    session.facts["threads"] = [
        threads_point(session, name, values, at, threads)
        for name, values, at in (("sparse", sparse, scenes.EDGE), ("dense", dense, scenes.DENSE_THRESHOLD))
        for threads in (1, 2)
    ]
    session.facts["stride"] = [stride_point(session, dense, stride) for stride in STRIDES]
    for text in summary(session.facts):
        session.say(text)


def point(session: Session, values: NDArray[np.uint8], threads: int) -> dict[str, Any]:
    """Seconds, peak memory and counts of one volume; VTK with as many threads."""
    counts = finish(count_steps(make_grid(values), scenes.EDGE))
    calls = {
        "seconds": lambda: marching_cubes(values, scenes.EDGE, normals=False, threads=threads),
        "vtk_seconds": peers.flying_edges(values, scenes.EDGE, False, threads),
    }
    seconds = session.race(calls, max(2, session.repeats // 2))
    peak = peak_bytes(calls["seconds"], mesh_bytes)
    return {
        "voxels": counts.voxels,
        "triangles": counts.faces,
        "bytes": values.nbytes,
        "peak_bytes": peak,
        "result_bytes": 12 * (counts.faces + counts.vertices),
        **{name: statistics.median(taken) for name, taken in seconds.items()},
    }


def threads_point(session: Session, name: str, values: NDArray[Any], at: float, threads: int) -> dict[str, Any]:
    """Seconds of one volume with so many threads."""
    seconds = session.race(
        {
            "seconds": lambda: marching_cubes(values, at, normals=False, threads=threads),
            "vtk_seconds": peers.flying_edges(values, at, False, threads),
        }
    )
    return {
        "scene": name,
        "threads": threads,
        **{key: statistics.median(taken) for key, taken in seconds.items()},
    }


def stride_point(session: Session, values: NDArray[Any], stride: int) -> dict[str, Any]:
    """Seconds at voxel sides of `stride` x `stride` x 1 pixels."""
    sides = (stride, stride, 1)
    counts = finish(count_steps(make_grid(values, sides), scenes.DENSE_THRESHOLD))
    seconds = session.race(
        {"seconds": lambda: marching_cubes(values, scenes.DENSE_THRESHOLD, sides, normals=False, threads=1)},
        max(2, session.repeats // 2),
    )
    return {
        "stride": stride,
        "voxels": counts.voxels,
        "triangles": counts.faces,
        "seconds": statistics.median(seconds["seconds"]),
    }


def summary(facts: dict[str, Any]) -> list[str]:
    """A line for every series: the exponent with which time grows."""
    return [
        f"time grows with voxels to the power {exponent(facts['size'], 'voxels', 'seconds'):.2f}, "
        f"beside the result memory to {exponent(facts['size'], 'voxels', 'peak_bytes'):.2f}",
        f"time grows with triangles to the power {exponent(facts['triangles'], 'triangles', 'seconds'):.2f}",
        f"time grows with the voxels that a stride leaves to {exponent(facts['stride'], 'voxels', 'seconds'):.2f}",
    ]


def exponent(points: list[dict[str, Any]], over: str, of: str) -> float:
    """Slope of the logarithms by least squares: 1 is linear."""
    x, y = (np.log([point[name] for point in points]) for name in (over, of))
    return float(((x - x.mean()) * (y - y.mean())).sum() / ((x - x.mean()) ** 2).sum())
