# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces with closed forms, and a fresh Blender file for every test."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from ctmc_addon.core import Reconstruction, ReconstructionSettings, Surface, Volume, reconstruct

FAR_MM = np.array([412.7, -318.3, 987.6])


@pytest.fixture
def scene():
    """The only scene of a fresh file with nothing in it."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


@pytest.fixture(scope="session")
def torus():
    """Build the result for a torus at a place in the patient, its midpoints off the linear crossings."""

    def build(center_mm=FAR_MM, rings=48, sides=24, name="torus", **settings) -> Reconstruction:
        around, along = np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij")
        u, v = 2 * np.pi * around.ravel() / rings, 2 * np.pi * along.ravel() / sides
        normals = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=1)
        linear = np.stack([30 * np.cos(u), 30 * np.sin(u), 0 * u], axis=1) + 10 * normals + center_mm
        midpoints = linear + 0.4 * np.sin(7 * u + 5 * v)[:, None] * normals
        number = np.arange(rings * sides).reshape(rings, sides)
        a, b = number, np.roll(number, -1, axis=0)
        c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
        faces = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)
        surface = Surface(
            midpoints.astype(np.float32), linear.astype(np.float32), faces.astype(np.int32), normals.astype(np.float32)
        )
        chosen = ReconstructionSettings(**{"threshold": 100.0, "alpha": 0.5, **settings})
        mesh = surface.at(chosen.alpha)
        assert mesh.closed
        assert mesh.volume > 0
        live = None if chosen.simplifies and chosen.simplifier == "builtin" else surface
        return Reconstruction(
            mesh=mesh,
            surface=live,
            settings=chosen,
            threshold=100.0,
            full_faces=len(faces),
            voxels_visited=2**40,
            stages=(),
            spacing_mm=(0.7, 0.7, 2.5),
            notes=("spacing assumed",),
            name=name,
        )

    return build


@pytest.fixture(scope="session")
def ball():
    """Build the extracted surface of a ball of 8 mm at the origin, whose gradient is radial."""

    def build(**settings) -> Reconstruction:
        values = (100 - 5 * distance_mm((24, 24, 24))).astype(np.float32)
        affine = np.eye(4)
        affine[:3, 3] = -11.5
        return reconstruct(Volume(values, affine, name="ball"), ReconstructionSettings(threshold=60.0, **settings))

    return build
