"""A CT volume: grey values on a grid, and where that grid lies in the patient.

Values are (slices, rows, columns); the affine maps the index (column, row, slice) = (x, y, z)
to RAS+ millimetres. This module owns every change of space.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import VolumeError

KINDS = ("HU", "grey value", "label")


@dataclass(frozen=True, eq=False)
class Volume:
    """Grey values or labels on a grid in patient space.

    Parameters
    ----------
    values : (slices, rows, columns) bool, int8 to int64, uint8 to uint64, float32 or float64
        Kept as it is, never copied; seen through a view that cannot be written to.
    affine : (4, 4) float64
        Index (x, y, z) = (column, row, slice) to RAS+ millimetres; may be oblique, mirrored or sheared.
    notes : tuple of str
        What a reader had to assume, in plain sentences for the user.
    name : str
        Stem of the file or folder; never taken from a DICOM tag.
    kind : {"HU", "grey value", "label"}
        What the values mean.
    label_names : mapping of int to str
        Names of label values, where the file has them.

    Raises
    ------
    VolumeError
        If the values are not three-dimensional numbers with two samples along every axis,
        or the affine is not finite, not affine or singular.
    """

    values: NDArray[Any]
    affine: NDArray[np.float64]
    notes: tuple[str, ...] = ()
    name: str = "volume"
    kind: str = "grey value"
    label_names: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = np.asarray(self.values)
        if values.ndim != 3:
            raise VolumeError(
                f"a volume has three dimensions (slices, rows, columns), not {values.ndim}: {values.shape}"
            )
        if min(values.shape) < 2:
            raise VolumeError(
                f"a surface needs at least 2 samples along every axis, and this volume has {values.shape} "
                "(slices, rows, columns); read the whole stack"
            )
        if values.dtype.kind not in "buif" or values.dtype.itemsize > 8 or values.dtype == np.float16:
            raise VolumeError(f"values of type {values.dtype} are no grey values; convert them to int16 or float32")
        if self.kind not in KINDS:
            raise VolumeError(f"kind is one of {', '.join(KINDS)}, not {self.kind!r}")
        locked = values.view()
        locked.flags.writeable = False
        object.__setattr__(self, "values", locked)
        object.__setattr__(self, "affine", checked_affine(self.affine))
        object.__setattr__(self, "notes", tuple(self.notes))

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Distance between neighbouring samples along (x, y, z), millimetres."""
        columns = np.sqrt((self.affine[:3, :3] ** 2).sum(axis=0))
        return (float(columns[0]), float(columns[1]), float(columns[2]))

    @property
    def orientation(self) -> str:
        """The patient's side each axis (x, y, z) runs towards, such as 'LPS'."""
        return axis_codes(self.affine)

    @property
    def size(self) -> tuple[int, int, int]:
        """Number of samples along (x, y, z)."""
        slices, rows, columns = self.values.shape
        return (columns, rows, slices)

    def cropped(self, low: tuple[int, int, int], high: tuple[int, int, int]) -> Volume:
        """The samples `low` to `high` (x, y, z), `high` left out, at their own place; a view, not a copy."""
        window = tuple(slice(start, stop) for start, stop in zip(low[::-1], high[::-1], strict=True))
        affine = self.affine.copy()
        affine[:3, 3] = to_ras_mm(self.affine, np.array([low], np.float64))[0]
        return Volume(self.values[window], affine, self.notes, self.name, self.kind, self.label_names)

    def __reduce__(self) -> tuple[Any, ...]:
        return (Volume, (self.values, self.affine, self.notes, self.name, self.kind, dict(self.label_names)))


def checked_affine(affine: Any) -> NDArray[np.float64]:
    """`affine` as a locked (4, 4) float64 array, or a `VolumeError` that says what is wrong with it."""
    matrix = np.array(affine, dtype=np.float64)
    if matrix.shape != (4, 4):
        raise VolumeError(f"an affine is a (4, 4) matrix, not {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise VolumeError("the affine holds NaN or infinite numbers; the file's geometry is broken")
    if (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
        raise VolumeError(f"the last row of an affine is 0 0 0 1, not {matrix[3]}")
    lengths = np.sqrt((matrix[:3, :3] ** 2).sum(axis=0))
    if (lengths == 0).any() or abs(determinant(matrix)) < 1e-6 * lengths.prod():
        raise VolumeError(
            "the affine is singular: its axes lie in one plane or have no length; "
            "set the spacing, or repair the file's geometry"
        )
    matrix.flags.writeable = False
    return matrix


def determinant(affine: NDArray[np.float64]) -> float:
    """Signed volume of one voxel, cubic millimetres; below zero where the axes are mirrored.

    Examples
    --------
    >>> determinant(np.diag([-0.5, 0.5, 2.0, 1.0]))
    -0.5
    """
    (a, b, c), (d, e, f), (g, h, i) = affine[:3, :3].tolist()
    return float(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def to_ras_mm(affine: NDArray[np.float64], points: NDArray[Any]) -> NDArray[np.float64]:
    """Move (n, 3) index positions (x, y, z) to RAS+ millimetres, (n, 3) float64.

    Written as sums in a fixed order, so every machine gives the same bits.
    """
    x, y, z = (points[:, axis].astype(np.float64) for axis in range(3))
    out = np.empty((len(points), 3))
    for row in range(3):
        out[:, row] = ((x * affine[row, 0] + y * affine[row, 1]) + z * affine[row, 2]) + affine[row, 3]
    return out


def to_index(affine: NDArray[np.float64], points_ras_mm: NDArray[Any]) -> NDArray[np.float64]:
    """Move (n, 3) RAS+ millimetres to index positions (x, y, z), (n, 3) float64."""
    inverse = np.eye(4)
    inverse[:3, :3] = cofactors(affine).T / determinant(affine)
    return to_ras_mm(inverse, points_ras_mm - affine[:3, 3])


def cofactors(affine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cofactor matrix (3, 3) of the affine's linear part: determinant times inverse transpose."""
    m = affine[:3, :3]
    out = np.empty((3, 3))
    for row in range(3):
        for column in range(3):
            r, s = (row + 1) % 3, (row + 2) % 3
            c, d = (column + 1) % 3, (column + 2) % 3
            out[row, column] = m[r, c] * m[s, d] - m[r, d] * m[s, c]
    return out


def normals_to_ras(affine: NDArray[np.float64], normals: NDArray[Any]) -> NDArray[np.float32]:
    """Carry (n, 3) outward normals from index space to RAS+ mm by the inverse transpose, unit length, float32."""
    matrix = np.eye(4)
    matrix[:3, :3] = cofactors(affine) / determinant(affine)
    turned = to_ras_mm(matrix, normals)
    length = np.sqrt(turned[:, 0] ** 2 + turned[:, 1] ** 2 + turned[:, 2] ** 2)
    length[length == 0] = 1.0
    return (turned / length[:, None]).astype(np.float32)


def axis_codes(affine: NDArray[np.float64]) -> str:
    """Letters of the patient's sides that the axes x, y and z run towards.

    Each axis takes the side it runs along most, no side twice, the clearest axis first.

    Examples
    --------
    >>> axis_codes(np.diag([-1.0, -1.0, 2.0, 1.0]))
    'LPS'
    """
    directions = affine[:3, :3] / np.sqrt((affine[:3, :3] ** 2).sum(axis=0))
    codes = ["?", "?", "?"]
    for side, axis in sorted(np.ndindex(3, 3), key=lambda at: -abs(directions[at])):
        letter = ("LR", "PA", "IS")[side][int(directions[side, axis] > 0)]
        taken = {code for code in codes if code in ("LR", "PA", "IS")[side]}
        if codes[axis] == "?" and not taken:
            codes[axis] = letter
    return "".join(codes)
