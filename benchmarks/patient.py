# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone and skin of a patient, and label masks, against VTK at equal threads and against Blender's own mesher."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.extraction.marching_cubes import marching_cubes
from ctmc_addon.core.phantom.phantom import LIVER, TUMOR

from . import peers, scenes
from .extraction import against_vtk, sized
from .measuring import Session

# name: threshold in HU; targets without and with normals
TISSUES = {"bone": (scenes.BONE, 0.8, 1.0), "skin": (scenes.SKIN, 0.5, 0.8)}
# name: label of the phantom; targets without and with normals
MASKS = {"liver": (LIVER, 0.6, 0.8), "tumors": (TUMOR, 0.4, 0.4)}
TRILINEAR = 1.1  # Target ratio to classic topology.
HALF = 0.5  # A mask's surface is half-way between 0 and 1.
BLENDER = "OpenVDB's convertToPolygons, as installed"


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    volumes = scenes.real_ct(session.data, session.also)
    if not volumes:
        session.say(f"No real CT in {session.data}: rows left out")
    for name, volume in volumes.items():
        for tissue, (threshold, bare, normals) in TISSUES.items():
            work = f"{tissue} of {name}, {sized(volume.values, threshold)}"
            race(session, work, volume.values, threshold, bare, normals)
            trilinear(session, f"{work}, trilinear topology", volume.values, threshold)
    labels = scenes.abdomen_phantom().labels.values
    for name, (label, bare, normals) in MASKS.items():
        mask = (labels == label).view(np.uint8)
        race(session, f"mask of the phantom's {name}, {sized(mask, HALF)}", mask, HALF, bare, normals)


def race(
    session: Session, work: str, values: NDArray[Any], threshold: float, bare: float | None, normals: float | None
) -> None:
    """Race VTK with one thread and two, without normals and with; then Blender's mesher."""
    against_vtk(session, work, values, threshold, False, {1: bare, 2: bare})
    against_vtk(session, f"{work}, normals", values, threshold, True, {1: normals, 2: normals})
    mesher = peers.openvdb(values, threshold)
    if mesher is None:
        session.say("This Blender has no OpenVDB module: its row is left out")
        return
    session.compare(
        work,
        lambda: marching_cubes(values, threshold, normals=False),
        {BLENDER: (mesher, None)},
        note="dual contouring into quads; its grid is filled before the clock starts",
        repeats=max(1, session.repeats // 3),
    )


def trilinear(session: Session, work: str, values: NDArray[Any], threshold: float) -> None:
    """Measure the cost of trilinear over classic topology, normals included."""
    session.compare(
        work,
        lambda: marching_cubes(values, threshold, topology="trilinear"),
        {"CTMC, classic topology": (lambda: marching_cubes(values, threshold, topology="classic"), TRILINEAR)},
    )
