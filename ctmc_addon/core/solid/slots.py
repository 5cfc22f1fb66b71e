# SPDX-License-Identifier: GPL-3.0-or-later
"""Separate structures that touch from each other and from the outside, by a few fields.

Structures far from each other share a slot, so that dozens of touching organs need only a few fields. Each structure
has a region, in blocks of the lattice, that holds all its parts. The regions in one slot do not overlap, so a triangle
belongs to the structure in whose region it lies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Flags, Floats, Indices
from ..errors import SettingsError
from ..machine.budget import Budget
from ..mesh.labels.label_complex import ComplexMesh
from ..progress import PAUSE, Steps
from ..volume.affine import to_index
from .body import Body, OnEdges, edges_of
from .cells.recipe import MOST_FIELDS
from .fields.distances import distances_bytes
from .fields.lattice import Lattice, with_box
from .fields.lattice_fields import HeldField, LatticeField

LEAST_BLOCK = 2  # A block has at least this many samples along a side, more if triangles are larger.
OUTSIDE = np.float32(-1e6)  # Depth far from all structures, mm.
POINTS_AT_ONCE = 1 << 18


class StructureSlots:
    """The slots of several bodies on one lattice, and their fields.

    Parameters
    ----------
    bodies : sequence of Body
        Bodies on the lattice or on parts of it.
    lattice : Lattice
    growth : float
        How far parts may reach beyond the bodies, mm.
    budget : Budget
    has_feet : bool
        Whether parts stand on feet, which reach from one side of a body to the opposite one.

    Attributes
    ----------
    slots : list of int
        The slot of every body.
    count : int
        Number of slots.
    """

    def __init__(
        self, bodies: Sequence[Body], lattice: Lattice, growth: float, budget: Budget, has_feet: bool = False
    ) -> None:
        self.bodies, self.lattice, self.budget = list(bodies), lattice, budget
        points = [with_box(body.mesh.vertices) if has_feet else body.mesh.vertices for body in bodies]
        surfaces = [_samples_at(each, lattice) for each in points]
        self.block = max(
            LEAST_BLOCK, *(_longest(samples, body.mesh.faces) for samples, body in zip(surfaces, bodies, strict=True))
        )
        regions = [_region(samples // self.block, lattice, growth, self.block, has_feet) for samples in surfaces]
        self.slots = _slots(regions)
        self.count = max(self.slots) + 1
        self._owners = np.full((self.count, *regions[0].shape), -1, np.int16)
        for number, (slot, region) in enumerate(zip(self.slots, regions, strict=True)):
            self._owners[slot][region] = number
        self._fields: dict[float, list[LatticeField]] = {}
        self._hollow: LatticeField | None = None

    @property
    def is_alone(self) -> bool:
        """Whether there is only one body, on the whole lattice."""
        return len(self.bodies) == 1 and self.bodies[0].lattice is self.lattice

    @property
    def needed_bytes(self) -> int:
        """Bytes of the fields and of the distances that they are made from."""
        return self._bytes_besides + 4 * self.lattice.samples * (self.count + 2)

    @property
    def _bytes_besides(self) -> int:
        """Bytes that do not depend on the number of slots."""
        largest = max(distances_bytes(body.lattice) for body in self.bodies)
        return largest + sum(5 * body.lattice.samples for body in self.bodies)

    def require_memory(self) -> None:
        """Raise a `MemoryLimitError` if the fields do not fit, with the number of structures that would."""
        if self.is_alone:
            return

        def remedy(available: int) -> str:
            fitting = (available - self._bytes_besides) // (4 * self.lattice.samples) - 2
            return f"choose at most {fitting} at once, or a region" if fitting > 1 else "choose a region"

        self.budget.require(self.needed_bytes, f"the fields of {len(self.bodies)} structures that touch", remedy)

    def require_fields(self, further: int) -> None:
        """Raise a `SettingsError` if one extraction cannot have all fields, with the number of structures that fit.

        `further` is the number of fields that do not belong to slots.
        """
        most = MOST_FIELDS - further
        if len(self.bodies) > 1 and most < self.count:
            raise SettingsError(
                f"{len(self.bodies)} structures touch and need {self.count + further} fields, more than {MOST_FIELDS}; "
                f"choose at most {max(1, most)} of them at once, or set interfaces to separate"
            )

    def fields_steps(self, thicken: float) -> Steps[tuple[list[LatticeField], dict[int, OnEdges]]]:
        """Return the fields of the slots for a `PartRule`, and their zeros on edges of the lattice."""
        if thicken not in self._fields:
            if self.is_alone:
                self._fields[thicken] = [(yield from self.bodies[0].field_steps(-thicken))]
            else:
                self._fields[thicken] = yield from self._slots_steps(thicken)
        on_edges = None if thicken else edges_of(self.bodies)
        fields = list(self._fields[thicken])
        return fields, {} if on_edges is None else dict.fromkeys(range(len(fields)), on_edges)

    def _slots_steps(self, thicken: float) -> Steps[list[LatticeField]]:
        """Return the fields of several slots.

        Depths are exact only near surfaces. Where two structures are far, the later one counts as farther, so that no
        sign changes there.
        """
        lattice = self.lattice
        far, later = 2 * sum(lattice.sides_mm), lattice.shortest_mm / 8
        depths = [np.full(lattice.shape, np.float32(-far - slot * later)) for slot in range(self.count)]
        for body, slot in zip(self.bodies, self.slots, strict=True):
            own = yield from body.distances_steps(-thicken)
            here = depths[slot][lattice.window_of(body.lattice)]
            np.maximum(here, own + np.float32(thicken), out=here)
            body.forget_distances(-thicken)
        behind, fields = depths.pop(), list[LatticeField]()
        while depths:
            front = depths.pop()
            either = np.maximum(front, behind)
            front -= behind
            fields.append(HeldField(lattice, front))
            behind = either
            yield PAUSE
        return [HeldField(lattice, behind, keeps_volume=thicken != 0), *reversed(fields)]

    def hollow_steps(self, level: float) -> Steps[LatticeField]:
        """Return the field that is above 0 deeper than a level in any body."""
        if self._hollow is None and self.is_alone:
            self._hollow = yield from self.bodies[0].field_steps(level)
        elif self._hollow is None:
            depth = np.full(self.lattice.shape, OUTSIDE)
            for body in self.bodies:
                own = yield from body.distances_steps(level)
                here = depth[self.lattice.window_of(body.lattice)]
                np.maximum(here, (own.astype(np.float64) - level).astype(np.float32), out=here)
                body.forget_distances(level)
            self._hollow = HeldField(self.lattice, depth, keeps_volume=True)
        return self._hollow

    def with_owners(self, mesh: ComplexMesh, sides: int) -> ComplexMesh:
        """Return the mesh with parts numbered by structures instead of slots; each structure has `sides` parts."""
        if self.count == len(self.bodies) and self.slots == list(range(self.count)):
            return mesh
        numbers = np.zeros_like(mesh.sides)
        for start in range(0, len(mesh.faces), POINTS_AT_ONCE):
            block = slice(start, start + POINTS_AT_ONCE)
            x, y, z = _samples_at(mesh.vertices[mesh.faces[block, 0]], self.lattice) // self.block
            for column in range(2):
                part = mesh.sides[block, column].astype(np.int64)
                slot, side = np.divmod(np.maximum(part, 1) - 1, sides)
                owner = self._owners[slot, z, y, x]
                assert (owner >= 0)[part > 0].all(), "regions hold all parts"
                numbers[block, column] = np.where(part > 0, 1 + owner * sides + side, 0)
        faces = mesh.faces
        turned = numbers[:, 0] < numbers[:, 1]  # The part behind has the larger number.
        faces = np.where(turned[:, None], faces[:, ::-1], faces)
        numbers[turned] = numbers[turned][:, ::-1]
        return ComplexMesh(mesh.vertices, np.ascontiguousarray(faces), numbers, mesh.normals)


def _samples_at(vertices: Floats, lattice: Lattice) -> Indices:
    """Return the indices (3, n) along x, y and z of the first samples at or after positions (n, 3) in RAS+ mm."""
    out = np.empty((3, len(vertices)), np.int64)
    for start in range(0, len(vertices), POINTS_AT_ONCE):
        block = slice(start, start + POINTS_AT_ONCE)
        index = to_index(lattice.affine, vertices[block].astype(np.float64))
        for axis, positions in enumerate((lattice.x, lattice.y, lattice.z)):
            at = np.searchsorted(positions, np.ascontiguousarray(index[:, axis]))
            out[axis, block] = np.minimum(at, len(positions) - 1)
    return out


def _longest(samples: Indices, faces: NDArray[np.int32]) -> int:
    """Return the largest extent of a triangle along an axis, in samples."""
    longest = 0
    for start in range(0, len(faces), POINTS_AT_ONCE):
        corners = samples[:, faces[start : start + POINTS_AT_ONCE]]  # (3, n, 3)
        longest = max(longest, int((corners.max(axis=2) - corners.min(axis=2)).max(initial=0)))
    return longest


def _region(surface: Indices, lattice: Lattice, growth: float, block: int, is_box: bool) -> Flags:
    """Return whether each block (z, y, x) may hold a part of a body, by the blocks of its vertices, (3, n) x to z."""
    at_surface = np.zeros([-(-size // block) for size in lattice.shape], bool)
    if is_box:
        x, y, z = (slice(int(along.min()), int(along.max()) + 1) for along in surface)
        at_surface[z, y, x] = True
    at_surface[surface[2], surface[1], surface[0]] = True
    for axis in range(3):  # A triangle reaches at most one block beyond those of its corners.
        at_surface = _wider(at_surface, axis)
    region = np.ones(at_surface.shape, bool)
    for axis in range(3):  # The inside lies between two blocks of the surface along each axis.
        after = np.logical_or.accumulate(at_surface, axis=axis)
        before = np.flip(np.logical_or.accumulate(np.flip(at_surface, axis), axis=axis), axis)
        region &= after & before
    for axis, side in zip((2, 1, 0), lattice.shortest_sides_mm, strict=True):
        for _ in range(math.ceil(growth / (block * side))):
            region = _wider(region, axis)
    return region


def _wider(region: Flags, axis: int) -> Flags:
    """Return a region with its neighbors along an axis."""
    wider = region.copy()
    grown, own = np.moveaxis(wider, axis, 0), np.moveaxis(region, axis, 0)
    grown[1:] |= own[:-1]
    grown[:-1] |= own[1:]
    return wider


def _slots(regions: Sequence[Flags]) -> list[int]:
    """Return a slot for every region, the largest first, so that regions in a slot do not overlap."""
    order = sorted(range(len(regions)), key=lambda at: (-int(np.count_nonzero(regions[at])), at))
    slots, taken = [0] * len(regions), list[Flags]()
    for at in order:
        free = next((slot for slot, region in enumerate(taken) if not (region & regions[at]).any()), len(taken))
        slots[at] = free
        if free == len(taken):
            taken.append(regions[at].copy())
        else:
            taken[free] |= regions[at]
    return slots
