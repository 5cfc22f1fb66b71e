# SPDX-License-Identifier: GPL-3.0-or-later
"""Thickness of walls: time and error against trimesh's largest spheres and the shape diameter of libigl."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.maps.thickness import Gap, Thickness
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh

from . import peers, walls
from .measuring import Row, Session

Doubles = NDArray[np.float64]
FINE = 0.0894  # Spacing at which the shell has a million vertices, mm.
SPACING, DEGREES = 0.5, 25.0  # Grid and pose of the closed forms.
VERTICES = 1000  # Vertices that slow peers are timed and judged at.
PEERS: dict[str, Callable[[TriangleMesh, Any], Callable[[], Doubles]]] = {
    "trimesh, spheres": peers.trimesh_spheres,
    "trimesh, rays": peers.trimesh_rays,
    "libigl, 30 rays": peers.shape_diameter,
}
JUDGED = ("trimesh, spheres", "libigl, 30 rays")
ERROR_TARGET, TIME_TARGET = 0.1, 1.0


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    errors(session)
    wall = walls.shell()
    volume = walls.sampled(wall, FINE)
    mesh = walls.surface_of(volume)
    surface = walls.mapped(mesh, volume)
    work = f"thickness at {len(mesh.vertices) / 1e6:.2f}M vertices, 1 thread"
    ours = session.seconds(lambda: walls.values_of(Thickness(), surface), max(1, session.repeats // 3))
    for name, make in PEERS.items():
        some = np.arange(0, len(mesh.vertices), max(1, len(mesh.vertices) // VERTICES) if "spheres" in name else 1)
        seconds, _ = session.timed(make(mesh, some))
        theirs = seconds * len(mesh.vertices) / len(some)
        note = "" if len(some) == len(mesh.vertices) else f"the peer at {len(some)} vertices, scaled"
        session.add(Row(session.part, work, name, ours, theirs, TIME_TARGET if name in JUDGED else None, note=note))
    gap, _ = session.timed(lambda: walls.values_of(Gap(), surface))
    session.add(Row(session.part, f"gap at {len(mesh.vertices) / 1e6:.2f}M vertices, 1 thread", "thickness", gap, ours))


def errors(session: Session) -> None:
    """Compare mean errors, as shares of the thickness, at the same vertices of closed forms."""
    for label in (False, True):
        for wall in walls.WALLS.values():
            volume = walls.sampled(wall, SPACING, DEGREES, label)
            mesh = walls.surface_of(volume, label)
            truth = walls.truth(wall, mesh, DEGREES)
            known = np.flatnonzero(np.isfinite(truth))
            some = known[:: max(1, len(known) // VERTICES)]
            mean = _error(walls.values_of(Thickness(), walls.mapped(mesh, volume))[some], truth[some])
            for name, make in PEERS.items():
                work = f"thickness of a {wall.name}, {'label' if label else 'field'} at {SPACING:g} mm: mean error"
                theirs = _error(make(mesh, some)(), truth[some])
                target = ERROR_TARGET if name in JUDGED else None
                session.add(Row(session.part, work, name, 100 * mean, 100 * theirs, target, unit="%"))


def _error(values: Doubles, truth: Doubles) -> float:
    """Return the mean error as a share; a value that is missing or infinite is off by all of the thickness."""
    shares = np.abs(values / truth - 1)
    return float(np.where(np.isfinite(shares), shares, 1.0).mean())
