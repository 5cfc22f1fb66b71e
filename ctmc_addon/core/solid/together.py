# SPDX-License-Identifier: GPL-3.0-or-later
"""Structures that are made together: the fields that tell them from each other and from what is around.

Structures that are far from each other share a slot, so that dozens need a few fields: of touching organs, each borders
on some others alone. A region of every structure, in blocks of the lattice, holds all of its parts; regions of a slot
do not overlap, so that the place of a triangle tells whose it is.
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
from .fields.lattice_fields import Field, HeldField

LEAST_BLOCK = 2  # Samples along a side of a block; more where triangles are larger.
OUTSIDE = np.float32(-1e6)  # The depth where a structure is far away, mm.
POINTS_AT_ONCE = 1 << 18


class Together:
    """The slots of several bodies on one lattice, and their fields.

    Parameters
    ----------
    bodies : sequence of Body
        Each on the lattice or on a part of it.
    lattice : Lattice
    growth : float
        By how much their parts may be larger than the bodies, mm.
    budget : Budget
    has_feet : bool
        Whether parts stand on feet, which go from one side of a body to another.

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
        self._fields: dict[float, list[Field]] = {}
        self._hollow: Field | None = None

    @property
    def is_alone(self) -> bool:
        """Whether there is one body, and its fields are those of the whole lattice."""
        return len(self.bodies) == 1 and self.bodies[0].lattice is self.lattice

    @property
    def needed_bytes(self) -> int:
        """Bytes that the fields and the distances that they are made of take."""
        return self._bytes_besides + 4 * self.lattice.samples * (self.count + 2)

    @property
    def _bytes_besides(self) -> int:
        """Bytes that do not depend on the number of slots."""
        largest = max(distances_bytes(body.lattice) for body in self.bodies)
        return largest + sum(5 * body.lattice.samples for body in self.bodies)

    def require_memory(self) -> None:
        """Raise a `MemoryLimitError` that says how many structures would fit if their fields do not."""
        if self.is_alone:
            return

        def remedy(available: int) -> str:
            fitting = (available - self._bytes_besides) // (4 * self.lattice.samples) - 2
            return f"choose at most {fitting} at once, or a region" if fitting > 1 else "choose a region"

        self.budget.require(self.needed_bytes, f"the fields of {len(self.bodies)} structures that touch", remedy)

    def require_fields(self, others: int) -> None:
        """Raise a `SettingsError` that says how many structures would fit if one extraction cannot have all fields.

        `others` are the fields beside those of the slots.
        """
        most = MOST_FIELDS - others
        if len(self.bodies) > 1 and most < self.count:
            raise SettingsError(
                f"{len(self.bodies)} structures touch and need {self.count + others} fields, more than {MOST_FIELDS}; "
                f"choose at most {max(1, most)} of them at once, or set interfaces to separate"
            )

    def fields_steps(self, thicken: float) -> Steps[tuple[list[Field], dict[int, OnEdges]]]:
        """Return the fields of the slots, as `PartRule` takes them, and where they are 0 on edges of the lattice."""
        if thicken not in self._fields:
            if self.is_alone:
                self._fields[thicken] = [(yield from self.bodies[0].field_steps(-thicken))]
            else:
                self._fields[thicken] = yield from self._slots_steps(thicken)
        known = None if thicken else edges_of(self.bodies)
        fields = list(self._fields[thicken])
        return fields, {} if known is None else dict.fromkeys(range(len(fields)), known)

    def _slots_steps(self, thicken: float) -> Steps[list[Field]]:
        """Return the fields of several slots.

        Depths are exact near a surface alone. Where two structures are far, the later one counts as the farther, so
        that no sign changes there.
        """
        lattice = self.lattice
        far, later = 2 * sum(lattice.sides_mm), lattice.shortest_mm / 8
        depths = [np.full(lattice.shape, np.float32(-far - slot * later)) for slot in range(self.count)]
        for body, slot in zip(self.bodies, self.slots, strict=True):
            own = yield from body.distances_steps(-thicken)
            here = depths[slot][lattice.window_of(body.lattice)]
            np.maximum(here, own + np.float32(thicken), out=here)
            body.forget_distances(-thicken)
        behind, fields = depths.pop(), list[Field]()
        while depths:
            front = depths.pop()
            either = np.maximum(front, behind)
            front -= behind
            fields.append(HeldField(lattice, front))
            behind = either
            yield PAUSE
        return [HeldField(lattice, behind, keeps_volume=thicken != 0), *reversed(fields)]

    def hollow_steps(self, level: float) -> Steps[Field]:
        """Return the field of what is deeper than a level in any of the bodies."""
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
        """Return a mesh whose parts are numbered by structures, `sides` each, instead of by slots."""
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
        turned = numbers[:, 0] < numbers[:, 1]  # Behind is the larger, as before.
        faces = np.where(turned[:, None], faces[:, ::-1], faces)
        numbers[turned] = numbers[turned][:, ::-1]
        return ComplexMesh(mesh.vertices, np.ascontiguousarray(faces), numbers, mesh.normals)


def _samples_at(vertices: Floats, lattice: Lattice) -> Indices:
    """Return the samples at places in RAS+ mm (n, 3), or the next ones, (3, n) along x, y and z."""
    out = np.empty((3, len(vertices)), np.int64)
    for start in range(0, len(vertices), POINTS_AT_ONCE):
        block = slice(start, start + POINTS_AT_ONCE)
        index = to_index(lattice.affine, vertices[block].astype(np.float64))
        for axis, positions in enumerate((lattice.x, lattice.y, lattice.z)):
            at = np.searchsorted(positions, np.ascontiguousarray(index[:, axis]))
            out[axis, block] = np.minimum(at, len(positions) - 1)
    return out


def _longest(samples: Indices, faces: NDArray[np.int32]) -> int:
    """Return over how many samples a triangle goes along an axis, at most."""
    longest = 0
    for start in range(0, len(faces), POINTS_AT_ONCE):
        corners = samples[:, faces[start : start + POINTS_AT_ONCE]]  # (3, n, 3)
        longest = max(longest, int((corners.max(axis=2) - corners.min(axis=2)).max(initial=0)))
    return longest


def _region(surface: Indices, lattice: Lattice, growth: float, block: int, is_box: bool) -> Flags:
    """Return the blocks that may hold a part of a body, (z, y, x), by those of its vertices, (3, n) from x to z."""
    at_surface = np.zeros([-(-size // block) for size in lattice.shape], bool)
    if is_box:
        x, y, z = (slice(int(along.min()), int(along.max()) + 1) for along in surface)
        at_surface[z, y, x] = True
    at_surface[surface[2], surface[1], surface[0]] = True
    for axis in range(3):  # A triangle goes into the blocks beside those of its corners at most.
        at_surface = _wider(at_surface, axis)
    region = np.ones(at_surface.shape, bool)
    for axis in range(3):  # What is between two blocks of the surface along each axis holds the inside.
        after = np.logical_or.accumulate(at_surface, axis=axis)
        before = np.flip(np.logical_or.accumulate(np.flip(at_surface, axis), axis=axis), axis)
        region &= after & before
    for axis, side in zip((2, 1, 0), lattice.shortest_sides_mm, strict=True):
        for _ in range(math.ceil(growth / (block * side))):
            region = _wider(region, axis)
    return region


def _wider(region: Flags, axis: int) -> Flags:
    """Return a region with the blocks beside it along an axis."""
    wider = region.copy()
    grown, own = np.moveaxis(wider, axis, 0), np.moveaxis(region, axis, 0)
    grown[1:] |= own[:-1]
    grown[:-1] |= own[1:]
    return wider


def _slots(regions: Sequence[Flags]) -> list[int]:
    """Return a slot for every region: those of one slot do not overlap; the largest come first."""
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
