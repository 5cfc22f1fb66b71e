# SPDX-License-Identifier: GPL-3.0-or-later
"""Painting the values of another volume onto the vertices of a surface, on one thread, against a limit in seconds."""

from __future__ import annotations

import numpy as np

from ctmc_addon.core import Budget, Volume
from ctmc_addon.core.progress import finish
from ctmc_addon.core.volume.sampling import sampled_steps

from .measuring import Row, Session

VERTICES = 1_000_000
GOAL = 0.3  # Seconds.
SIZE = (200, 512, 512)


def measure(session: Session) -> None:
    """Paint a CT of another grid onto a sphere, whose vertices come in the order of slices."""
    affine = np.array([[0.69, 0.1, 0.0, -180], [-0.1, 0.69, 0.05, -140], [0.0, -0.05, 1.5, -150], [0, 0, 0, 1]])
    volume = Volume(np.random.default_rng(0).integers(-1000, 2000, SIZE).astype(np.int16), affine, kind="HU")
    number = np.arange(VERTICES)
    height = 1 - 2 * (number + 0.5) / VERTICES
    around, across = np.pi * (3 - np.sqrt(5)) * number, np.sqrt(1 - height * height)
    sphere = np.stack([across * np.cos(around), across * np.sin(around), height], axis=1)
    center = affine[:3, :3] @ (np.array(SIZE[::-1]) / 2) + affine[:3, 3]
    points = (100 * sphere + center).astype(np.float32)
    budget = Budget(threads=1)
    assert not np.isnan(finish(sampled_steps(volume, points, budget=budget))).any(), "the sphere lies in the volume"
    runs = session.race({"CTMC": lambda: finish(sampled_steps(volume, points, budget=budget))})["CTMC"]
    work = f"painting {VERTICES / 1e6:.0f}M vertices from another grid, 1 thread"
    session.add(Row(session.part, work, "limit", session.typical(runs), GOAL, 1.0, runs={"CTMC": runs}))
