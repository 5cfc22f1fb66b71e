# SPDX-License-Identifier: GPL-3.0-or-later
"""Hollow, thicken, cut, peg and drain balls, capsules, tori and boxes, and measure all against closed forms.

Lengths are in voxels, which are 1 mm. Every run checks that all parts are closed, turned outward and free of crossings,
alone and together, and that drains make the handles that they should.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from solids import together

from ctmc_addon.core import ReconstructionSettings, TriangleMesh, finish, reconstruct
from ctmc_addon.core.mesh.distance.signed_distance import SignedSurface
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.solid import Cut, Drain, HalfSpace, Pegs, SolidRequest, solid_parts

from .documents import table
from .solid_forms import FORMS, Posed, ball_volume, poses

Doubles = NDArray[np.float64]
NORMALS = ((0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (1.0, 2.0, -3.0))
WALL, MORE, PEG, CLEARANCE, DRAIN = 0.12, 0.09, 0.3, 0.015, 0.2  # Shares of the voxels across the body.
LIMITS = {"volume": 0.005, "mean": 0.05, "95": 0.15, "thinnest": 0.25, "gap": 0.1, "rims": 0.1}
TRIALS = ((20, False, 3), (32, False, 1), (20, True, 3))  # Voxels across, label, poses: the last ones are turned.
VOLUMES = ("plain", "hollow", "thicken", "thicken and hollow", "halves", "pegged halves")
ON_PLANE = 0.005  # A plane passes samples by 1/256 of a voxel at least.


@dataclass
class Measured:
    """What is off, of all poses: volumes as shares, lengths in voxels."""

    volumes: dict[str, list[float]] = field(default_factory=dict)
    walls: list[Doubles] = field(default_factory=list)
    gaps: list[Doubles] = field(default_factory=list)
    rims: list[Doubles] = field(default_factory=list)

    def add(self, name: str, volume: float, exact: float) -> None:
        """Keep the error of a volume."""
        self.volumes.setdefault(name, []).append(volume / exact - 1)


class Trial:
    """All operations on one body in one pose."""

    def __init__(self, posed: Posed, across: float, label: bool, found: Measured) -> None:
        self.posed, self.across, self.found = posed, across, found
        self.volume = posed.volume(label)
        self.settings = ReconstructionSettings(label=1) if label else ReconstructionSettings(threshold=0.0)
        self.exact = posed.form.volume
        self.middle = tuple(posed.middle.tolist())
        self.plain = reconstruct(self.volume, self.settings).mesh

    def run(self) -> None:
        """Measure all."""
        self.found.add("plain", self.plain.volume, self.exact(0))
        self.thicken_and_hollow()
        for normal in NORMALS:
            self.cut(normal)
        self.pegs(NORMALS[2])
        self.drain()

    def made(self, **solid: Any) -> list[TriangleMesh]:
        """Return the parts, after checks."""
        meshes = [part.mesh for part in solid_parts(self.volume, self.settings, SolidRequest(**solid))]
        require_sound(meshes)
        return meshes

    def thicken_and_hollow(self) -> None:
        """Measure volumes and walls."""
        wall, more = WALL * self.across, MORE * self.across
        (thick,) = self.made(thicken=more)
        self.found.add("thicken", thick.volume, self.exact(more))
        for name, outer, moved, solid in (
            ("hollow", self.plain, 0.0, {}),
            ("thicken and hollow", thick, more, {"thicken": more}),
        ):
            (mesh,) = self.made(hollow=wall, **solid)
            self.found.add(name, mesh.volume, self.exact(moved) - self.exact(moved - wall))
            depth = -distances(mesh.vertices, outer)
            self.found.walls.append(depth[depth > wall / 2] - wall)

    def cut(self, normal: tuple[float, float, float]) -> None:
        """Measure halves and their rims."""
        cut = Cut(self.middle, normal)
        parts = self.made(cuts=[cut])
        self.found.add("halves", sum(part.volume for part in parts), self.plain.volume)
        self.found.rims.append(self.off_line(parts, HalfSpace(cut.point, cut.normal)))

    def off_line(self, parts: list[TriangleMesh], plane: HalfSpace) -> Doubles:
        """Return how far the rims of a cut are from where the plane meets the body."""
        points = rim_of(parts[0], plane)
        at = self.posed.at(points)
        slope = np.stack([self.posed.at(points + 1e-4 * each[:, None]) - at for each in np.eye(3)]) / 1e-4
        slope -= plane.unit[:, None] * (plane.unit[:, None] * slope).sum(axis=0)
        return np.asarray(np.hypot(at / np.sqrt((slope**2).sum(axis=0)), plane.at(points)))

    def pegs(self, normal: tuple[float, float, float]) -> None:
        """Measure the gap between pegs and holes, and the volumes of both parts."""
        size, gap = PEG * self.across, CLEARANCE * self.across
        cut, plane = Cut(self.middle, normal), HalfSpace(self.middle, normal)
        upper, lower = self.made(cuts=[cut], pegs=Pegs(1, size, size, gap))
        of_peg = upper.vertices[plane.at(upper.vertices.T.astype(np.float64)) < -0.5]
        self.found.gaps.append(distances(of_peg, lower) - gap)
        peg, hole = (bar_volume(size / 2 + more, size / 2) for more in (0.0, gap))
        self.found.add("pegged halves", upper.volume + lower.volume, self.plain.volume - (hole - peg))

    def drain(self) -> None:
        """Require the handles that one drain and two make."""
        wall, hole = WALL * self.across, DRAIN * self.across
        genus = self.posed.form.genus
        far = self.posed.turned(np.array([[1.0], [0.0], [0.0]]) * self.posed.form.inner)[:, 0]
        near = (self.posed.middle + far).tolist(), (self.posed.middle - far).tolist()
        for count in (1, 2):
            (mesh,) = self.made(hollow=wall, drains=[Drain(hole, tuple(point)) for point in near[:count]])
            expected = 2 - 2 * (2 * genus + count - 1)
            if (mesh.components, mesh.euler) != (1, expected):
                raise AssertionError(f"{count} drains: {mesh.components} pieces, Euler number {mesh.euler}")


def require_sound(meshes: list[TriangleMesh]) -> None:
    """Raise an `AssertionError` for a part that is open, or turned, or crosses itself or another."""
    crossings = len(self_intersections(*together(meshes)))
    if crossings or not all(mesh.closed and mesh.volume > 0 for mesh in meshes):
        raise AssertionError(f"{crossings} crossings, closed: {[mesh.closed for mesh in meshes]}")


def rim_of(mesh: TriangleMesh, plane: HalfSpace) -> Doubles:
    """Return the vertices of a part at which triangles of a plane end, (3, n)."""
    points = mesh.vertices.T.astype(np.float64)
    on_plane = np.abs(plane.at(points)) < ON_PLANE
    flat = on_plane[mesh.faces].all(axis=1)
    rim = np.intersect1d(mesh.faces[flat], mesh.faces[~flat])
    return points[:, rim]


def distances(points: NDArray[Any], mesh: TriangleMesh) -> Doubles:
    """Return the signed distances of points to a closed mesh, positive outside."""
    surface = SignedSurface()
    finish(surface.prepare_steps(mesh))
    return finish(surface.distances_steps(np.asarray(points, np.float64)))[0]


def bar_volume(radius: float, straight: float) -> float:
    """Return the volume of a bar with one round end."""
    return float(np.pi * radius**2 * straight + ball_volume(radius) / 2)


def solids_table() -> str:
    """Print the largest errors of all poses, those above the limits in bold."""
    rows = [["limit", "", *["0.5 %"] * len(VOLUMES), "0.05 / 0.15 / -0.25", "0.1", "0.1"]]
    for make in FORMS:
        for across, label, count in TRIALS:
            found = Measured()
            for pose in poses()[-count:]:
                Trial(Posed(make(across / 2), pose), across, label, found).run()
            rows.append([make.__name__, f"{across}, {'label' if label else 'gray'}", *cells(found, label)])
    names = ["plain", "hollow", "thicken", "both", "halves", "with pegs", "wall", "gap", "rims"]
    return table(["body", "voxels across", *names], rows)


def cells(found: Measured, label: bool) -> list[str]:
    """Return the cells of a row."""
    out = []
    for name in VOLUMES:
        worst = max(found.volumes[name], key=abs)
        out.append(marked(f"{100 * worst + 0.0:+.2f} %", abs(worst) > LIMITS["volume"]))
    walls, gap = np.concatenate(found.walls), float(np.abs(np.concatenate(found.gaps)).max())
    mean, most, thinnest = float(np.abs(walls).mean()), float(np.quantile(np.abs(walls), 0.95)), float(walls.min())
    too_far = mean > LIMITS["mean"] or most > LIMITS["95"] or -thinnest > LIMITS["thinnest"]
    out.append(marked(f"{mean:.3f} / {most:.3f} / {thinnest:.3f}", too_far))
    out.append(marked(f"{gap:.3f}", gap > LIMITS["gap"]))
    rims = float(np.concatenate(found.rims).max())
    return [*out, "" if label else marked(f"{rims:.3f}", rims > LIMITS["rims"])]


def marked(text: str, is_miss: bool) -> str:
    """Return a text in bold if a limit is exceeded."""
    return f"**{text}**" if is_miss else text
