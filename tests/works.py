# SPDX-License-Identifier: GPL-3.0-or-later
"""Seven works whose bytes must be the same on every processor; as a program it prints the SHA-256 of each.

The volumes are made of whole numbers and square roots alone, so a digest that differs is a fault of the work.
"""

from __future__ import annotations

import hashlib
import json

import numpy as np
from shapes import distance_mm

from ctmc_addon.core import Budget, ReconstructionSettings, Volume, finish, reconstruct, reconstruct_labels
from ctmc_addon.core.segmentation import Click, brushed_window, compete_steps, scissors_steps
from ctmc_addon.core.segmentation.competition.border import _prices

SHAPE = (22, 30, 34)
OBLIQUE = np.array([[-0.71, 0.13, 0.2, 12.0], [0.17, 0.83, -0.11, -9.0], [0.09, 0.15, 1.3, 30.0], [0, 0, 0, 1]])
ONE = Budget(threads=1)


def noise(most: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(-most, most + 1, SHAPE)


def bone(most: int = 330) -> Volume:
    """A shell with marrow in it, and noise of at most so many HU, which can make holes and small components."""
    away = np.abs(distance_mm(SHAPE, spacing=(0.71, 0.83, 1.3)) - 9.0)
    return Volume(np.rint(700 - 250 * away + noise(most, 1)).astype(np.int16), OBLIQUE, kind="HU")


def labels() -> Volume:
    """Three labels of a ball that touch, with islands."""
    z, y, x = np.indices(SHAPE)
    ball = distance_mm(SHAPE, spacing=(0.71, 0.83, 1.3)) < 11
    values = np.where(ball, 1 + (x + y % 5 > 18) + 2 * (x + z % 3 > 24), 0)
    values[noise(150, 2) == 150] = 3
    return Volume(values.astype(np.uint8), OBLIQUE, kind="label")


def soft() -> Volume:
    """A body of soft tissue in another, with noise."""
    values = 40 + 60 * (distance_mm(SHAPE, spacing=(0.71, 0.83, 1.3)) < 7.5) + noise(24, 3)
    return Volume(values.astype(np.int16), OBLIQUE, kind="HU")


def surface(volume: Volume, **settings) -> list[np.ndarray]:
    mesh = reconstruct(volume, ReconstructionSettings(**settings), ONE).mesh
    return [mesh.vertices, mesh.faces]


def shared_walls() -> list[np.ndarray]:
    settings = ReconstructionSettings(reduction=0.6)
    results = reconstruct_labels(labels(), settings, None, ONE).surfaces
    return [array for result in results for array in (result.mesh.vertices, result.mesh.faces)]


def clicks() -> list[np.ndarray]:
    """What clicks compete for, then drawn on by a ball and a disc and cut by a lasso; prices of a million blocks."""
    volume = soft()
    middle = tuple(side // 2 for side in SHAPE)
    structures = finish(compete_steps(volume, [Click(middle, 1), Click((3, 4, 5), 0), Click((18, 25, 29), 0)]))
    mask = structures == 1
    stroke = [(7.625, -1.25, 42.75), (-0.875, 10.5, 45.625), (3.5, 11.25, 53.25)]
    for normal in (None, (1.0, 2.0, 3.0)):
        window, touched = brushed_window(volume, stroke, 3.0, normal)
        mask[window] |= touched
    lasso = np.array([[-0.3, -0.4], [0.5, -0.2], [0.4, 0.45], [-0.2, 0.3]])
    view = np.array(
        [[0.05, 0.01, 0.004, -0.44], [0.0, 0.06, -0.01, 0.17], [0.01, 0.0, -0.1, 3.1], [0.0, 0.0, 0.0, 1.0]]
    )
    many = (
        np.random.default_rng(4).integers(-600, 600, (100, 100, 100)).astype(np.float32) / 16
    )  # more blocks than here
    return [structures, mask, finish(scissors_steps(mask, volume, view, lasso, depth_mm=9.0)), _prices(many)]


WORKS = {
    "noisy bone, simplified": lambda: surface(bone(), threshold=450.0, reduction=0.8),
    "topology of the trilinear interpolant": lambda: surface(bone(), threshold=450.0, topology="trilinear"),
    "labels with shared walls": shared_walls,
    "simplified within a maximum error": lambda: surface(bone(60), threshold=450.0, max_error_mm=0.4),
    "the largest alpha of even triangles": lambda: surface(bone(60), threshold=450.0, alpha="auto"),
    "a Gaussian and a stride": lambda: surface(bone(), threshold=300.0, smoothing_mm=0.9, stride=(2, 1, 1)),
    "clicks, strokes and scissors": clicks,
}


def digest(arrays: list[np.ndarray]) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


if __name__ == "__main__":
    print(json.dumps({name: digest(work()) for name, work in WORKS.items()}))
