# SPDX-License-Identifier: GPL-3.0-or-later
"""Print how often a surface has other parts or another Euler number than the trilinear interpolant's.

Single voxels, and grids of 5 x 5 x 5 samples whose outermost are outside, of random values. The truth is resampled
(tests/oracles/trilinear.py). Give a number of each; with --write-docs the table goes into docs/development/accuracy.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from meshes import non_manifold_edges
from numpy.typing import NDArray
from oracles.trilinear import grid_topology, voxel_topology

from ctmc_addon.core import TriangleMesh, marching_cubes
from ctmc_addon.core.errors import ThresholdError
from ctmc_addon.core.extraction import TOPOLOGIES

from .accuracy import PAGE
from .documents import replaced, table

Truth = tuple[int, int] | None  # Euler number and parts; None where the oracle is undecided
COUNT, SEED, STRIPE = 10_000, 0, 1000


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=COUNT, help="of voxels, and of grids")
    parser.add_argument("--write-docs", action="store_true", help="put the table into docs/development/accuracy.md")
    given = parser.parse_args()
    text = topology_table(given.count)
    print(text)
    if given.write_docs:
        PAGE.write_text(replaced(PAGE.read_text(encoding="utf-8"), "topology", text), encoding="utf-8")
        print(f"written: {PAGE.name}")
    return 0


def topology_table(count: int) -> str:
    """Return how many of `count` voxels and grids are wrong, undecided and not closed."""
    rows = []
    for name, values_of, truth_of, closed in (
        ("single voxels", random_voxel, voxel_truth, False),
        ("closed grids", random_grid, grid_truth, True),
    ):
        wrong, undecided, torn = judged(count, values_of, truth_of, closed)
        for topology in TOPOLOGIES:
            open_ = str(torn[topology]) if closed else ""
            rows.append([name, topology, str(count), str(wrong[topology]), str(undecided), open_])
    return table(["values", "topology", "number", "wrong", "undecided by the oracle", "not closed or manifold"], rows)


def judged(
    count: int,
    values_of: Callable[[np.random.Generator], NDArray[np.float64]],
    truth_of: Callable[[NDArray[np.float64]], Truth],
    closed: bool,
) -> tuple[dict[str, int], int, dict[str, int]]:
    """Return the number of wrong ones for each topology, of undecided ones, and of open ones for each topology."""
    draw = np.random.Generator(np.random.PCG64(SEED))
    wrong, torn, undecided = dict.fromkeys(TOPOLOGIES, 0), dict.fromkeys(TOPOLOGIES, 0), 0
    for number in range(count):
        values = values_of(draw)
        truth = truth_of(values)
        undecided += truth is None
        for topology in TOPOLOGIES:
            mesh = surface(values, topology)
            if mesh is None:
                wrong[topology] += truth not in (None, (0, 0))
                continue
            wrong[topology] += truth is not None and (mesh.euler, mesh.components) != truth
            torn[topology] += closed and not (mesh.closed and not len(non_manifold_edges(mesh)))
        if number % STRIPE == STRIPE - 1:
            print(f"{number + 1}: wrong {wrong}", flush=True)
    return wrong, undecided, torn


def surface(values: NDArray[Any], topology: str) -> TriangleMesh | None:
    """Return the surface at 0, None if there is none; values are (x, y, z)."""
    try:
        return marching_cubes(values.transpose(2, 1, 0), 0.0, normals=False, threads=1, topology=topology)
    except ThresholdError:
        return None


def random_voxel(draw: np.random.Generator) -> NDArray[np.float64]:
    """Return corner values from -1 to 1."""
    return draw.uniform(-1, 1, (2, 2, 2))


def random_grid(draw: np.random.Generator) -> NDArray[np.float64]:
    """Return 27 values from -1 to 1 within a border of -1."""
    return np.pad(draw.uniform(-1, 1, (3, 3, 3)), 1, constant_values=-1.0)


def voxel_truth(values: NDArray[np.float64]) -> Truth:
    """Return the true topology of a single voxel, whose surface ends at its faces."""
    topology = voxel_topology(values)
    return None if topology is None else (topology[0], len(topology[1]))


def grid_truth(values: NDArray[np.float64]) -> Truth:
    """Return the true topology of a grid."""
    if (values < 0).all():
        return 0, 0
    topology: Truth = grid_topology(values, 0.0)
    return topology


if __name__ == "__main__":
    raise SystemExit(main())
