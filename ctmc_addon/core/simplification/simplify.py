# SPDX-License-Identifier: GPL-3.0-or-later
"""Fewer triangles for nearly the same surface: edge collapse by quadric error.

What never changes: closed stays closed and manifold stays manifold (link condition), no triangle turns
over, vertices on a border stay where they are and border edges are not collapsed. Triangles at edges
with three triangles or more are left alone. A small component may go as a whole, the largest never does, nor one that
encloses more than a limit.
Small handles are cut and capped, but never within a maximum error.
Garland and Heckbert 1997, doi:10.1145/258734.258849.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Generic, TypeVar

from ..machine.budget import Budget
from ..mesh.triangle_mesh import SurfacePiece, SurfacePieces, TriangleMesh
from ..progress import Steps, WithResult, finish
from .batches.in_batches import in_batches_steps
from .batches.pieces import batches_steps
from .policy import POLICY, Policy
from .whole import Goal, Simplification, require_finite, whole_steps

T = TypeVar("T")
WHOLE_MACHINE = Budget()


def simplify(
    mesh: TriangleMesh,
    reduction: float | None = None,
    target_faces: int | None = None,
    max_error: float | None = None,
    budget: Budget = WHOLE_MACHINE,
    largest_component: float = math.inf,
) -> TriangleMesh:
    """The surface with fewer triangles. Exactly one of the three goals is given.

    Parameters
    ----------
    mesh : TriangleMesh
        In any unit; normals are carried along.
    reduction : float in [0, 1)
        Share of the triangles to remove.
    target_faces : int, 1 or more
        Triangles to keep at most.
    max_error : float above 0
        Bound on the distance to the input, both ways, in the mesh's unit.
    budget : Budget, optional
        By default what the machine has. A surface of more than its `whole_faces` is simplified in batches side by
        side. Threads and memory do not change the result.
    largest_component : float, optional
        Components that enclose more than this, in the cube of the mesh's unit, do not go as a whole, even where the
        goal is then not reached. A reconstruction has 20 mm3 here. Where it is done in batches, components that hang
        together across them are judged by half of that and by their boxes.

    Returns
    -------
    TriangleMesh
        No more triangles than asked, and at most one fewer, or three fewer where only whole components are left
        to go; more only if collapsing more edges would break what is promised above (the last step's message
        gives the reason).

    Raises
    ------
    SettingsError
        Without exactly one goal, or with one outside its limits.
    MeshError
        If a vertex is not finite.
    MemoryLimitError
        Before the work, if it would take more memory than that.

    Examples
    --------
    >>> import numpy as np
    >>> corners = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 0]], np.float32)
    >>> square = TriangleMesh(corners, np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], np.int32))
    >>> len(simplify(square, reduction=0.5).faces)
    2
    """
    return finish(simplify_steps(mesh, reduction, target_faces, max_error, budget, largest_component))


def simplify_steps(
    mesh: TriangleMesh,
    reduction: float | None = None,
    target_faces: int | None = None,
    max_error: float | None = None,
    budget: Budget = WHOLE_MACHINE,
    largest_component: float = math.inf,
) -> Steps[TriangleMesh]:
    """`simplify` as steps; the last message says how many triangles there are, and why if that is more than asked."""
    goals = (reduction, target_faces, max_error)
    return (yield from simplification_steps(mesh, *goals, budget, largest_component)).mesh


def simplification_steps(
    mesh: TriangleMesh,
    reduction: float | None = None,
    target_faces: int | None = None,
    max_error: float | None = None,
    budget: Budget = WHOLE_MACHINE,
    largest_component: float = math.inf,
    policy: Policy = POLICY,
) -> Steps[Simplification]:
    """Do what `simplify_steps` does, and also return what was removed."""
    goal = Goal(reduction, target_faces, max_error, largest_component, policy)
    goal.target(1)
    if len(mesh.faces) <= goal.most_whole(budget):
        return (yield from whole_steps(mesh, goal, budget))
    require_finite(mesh)
    return (yield from _pieces_steps(_one_piece(mesh), goal, budget, len(mesh.faces))).simplification


@dataclass(frozen=True, eq=False)
class _SimplifiedPieces(Generic[T]):
    """A simplified surface, the triangles it had, and the result of the maker of its pieces."""

    simplification: Simplification
    full_faces: int
    info: T


def simplified_pieces_steps(
    pieces: SurfacePieces[T], goal: Goal, budget: Budget = WHOLE_MACHINE
) -> Steps[_SimplifiedPieces[T]]:
    """Simplify a surface that comes in pieces; the same bytes as of the mesh of all its pieces, wherever it was cut.

    Parameters
    ----------
    pieces : generator of Step and SurfacePiece
        Closed at the end, whatever happens.
    goal : Goal
        Goal with the policy to follow.
    budget : Budget, optional

    Raises
    ------
    SettingsError, MeshError, MemoryLimitError
        As of `simplify`; a MeshError too where no piece has a triangle.
    """
    goal.target(1)
    return (yield from _pieces_steps(pieces, goal, budget))


def _pieces_steps(
    pieces: SurfacePieces[T], goal: Goal, budget: Budget, face_count: int | None = None
) -> Steps[_SimplifiedPieces[T]]:
    """Simplify pieces; `face_count` is the number of their triangles, if it is known."""
    source = WithResult(batches_steps(pieces, goal.sizes(budget)[0], goal.most_whole(budget)))
    simplification, full_faces = yield from in_batches_steps(source, goal, budget, face_count)
    return _SimplifiedPieces(simplification, full_faces, source.result)


def _one_piece(mesh: TriangleMesh) -> SurfacePieces[None]:
    yield SurfacePiece(mesh.vertices, mesh.faces, mesh.normals)
