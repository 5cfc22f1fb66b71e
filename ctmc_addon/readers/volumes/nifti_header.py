# SPDX-License-Identifier: GPL-3.0-or-later
"""The header of NIfTI-1 and NIfTI-2, as nifti.nimh.nih.gov/nifti-1 and nifti-2 describe it.

What can be mended is mended as nibabel does: a side of 0 mm is 1 mm, an orientation of an unknown code is none. nibabel
itself is not asked, as its import takes longer than many a label; the tests compare with it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

SIZES = (348, 540)  # bytes of a header of version 1 and 2, which begins with this number
# The byte where a field begins and its type as `struct` writes it, in version 1 and 2.
FIELDS = {
    "dim": ((40, "8h"), (16, "8q")),
    "intent": ((68, "h"), (504, "i")),
    "datatype": ((70, "h"), (12, "h")),
    "pixdim": ((76, "8f"), (104, "8d")),
    "vox_offset": ((108, "f"), (168, "q")),
    "scale": ((112, "2f"), (176, "2d")),
    "xyzt_units": ((123, "B"), (500, "i")),
    "codes": ((252, "2h"), (344, "2i")),
    "quatern": ((256, "3f"), (352, "3d")),
    "qoffset": ((268, "3f"), (376, "3d")),
    "srow": ((280, "12f"), (400, "12d")),
    "magic": ((344, "4s"), (4, "4s")),
    "eol_check": ((348, "0b"), (8, "4b")),
}
MAGIC = ((b"n+1\0", b"ni1\0"), (b"n+2\0", b"ni2\0"))  # of one file, and of a pair
LINE_ENDS = ((), (13, 10, 26, 10))  # changed where a transfer took the file for text
PRECISION = (np.float32, np.float64)  # of a quaternion
TYPES = {
    2: "u1", 4: "i2", 8: "i4", 16: "f4", 32: "c8", 64: "f8", 128: "u1,u1,u1", 256: "i1", 512: "u2", 768: "u4",
    1024: "i8", 1280: "u8", 1536: "g", 1792: "c16", 2048: "G", 2304: "u1,u1,u1,u1",
}  # fmt: skip
UNITS = {0: "unknown", 1: "meter", 2: "mm", 3: "micron"}
LAST_CODE = 5  # of an orientation; 0 is none
LABEL_INTENT = 1002  # NIFTI_INTENT_LABEL: each value is the number of a label


@dataclass(frozen=True, eq=False)
class NiftiHeader:
    """A header whose type and magic are known.

    Parameters
    ----------
    content : bytes
    version : int
        0 or 1: the column of the tables above.
    order : {"<", ">"}
        Of the bytes of a number.
    """

    content: bytes
    version: int
    order: Literal["<", ">"]

    def __getitem__(self, field: str) -> tuple[Any, ...]:
        """Return the numbers of a field."""
        at, kind = FIELDS[field][self.version]
        return struct.unpack_from(self.order + kind, self.content, at)

    @property
    def size(self) -> int:
        """Return the bytes of the header."""
        return SIZES[self.version]

    @property
    def sides(self) -> tuple[int, ...]:
        """Return the size along each axis, x first."""
        axes, *sides = self["dim"]
        return tuple(sides[:axes])

    @property
    def dtype(self) -> np.dtype[Any]:
        """Return the type of the values in the file; RGB has fields."""
        return np.dtype(TYPES[self["datatype"][0]]).newbyteorder(self.order)

    @property
    def start(self) -> float:
        """Return the byte where the values begin, as it is written."""
        return float(self["vox_offset"][0])

    @property
    def scale(self) -> tuple[float, float]:
        """Return slope and intercept of the values, (1, 0) where the file has none.

        Raises
        ------
        ValueError
            If the intercept is not finite.
        """
        slope, intercept = self["scale"]
        if slope == 0 or not np.isfinite(slope):
            return 1.0, 0.0
        if not np.isfinite(intercept):
            raise ValueError(f"valid slope but invalid intercept {intercept:g}")
        return slope, intercept

    @property
    def holds_labels(self) -> bool:
        """Return whether the file says that its values are labels."""
        return bool(self["intent"] == (LABEL_INTENT,))

    @property
    def unit(self) -> str:
        """Return the unit of positions: mm, meter, micron or unknown; of another code its number."""
        code = self["xyzt_units"][0] & 7
        return UNITS.get(code, f"xyzt_units {code}")

    @property
    def codes(self) -> tuple[int, int]:
        """Return the codes of qform and sform; 0 says that there is none."""
        qform, sform = (code if 0 <= code <= LAST_CODE else 0 for code in self["codes"])
        return qform, sform

    @property
    def pixdim(self) -> NDArray[np.float64]:
        """Return the distance between samples along each axis, (3,) in the file's unit, as it is written."""
        return np.array(self["pixdim"][1:4])

    @property
    def sform(self) -> NDArray[np.float64]:
        """Return what maps (i, j, k) to RAS+ in the file's unit by its rows, whether they are in use or not."""
        return np.array([*np.reshape(self["srow"], (3, 4)), (0.0, 0.0, 0.0, 1.0)])

    @property
    def qform(self) -> NDArray[np.float64]:
        """Return what maps (i, j, k) to RAS+ in the file's unit by quaternion and pixdim, in use or not.

        Raises
        ------
        ValueError
            If the quaternion is longer than 1.
        """
        sides = mended_sides(self.pixdim)
        sides[2] *= -1.0 if self["pixdim"][0] == -1 else 1.0
        affine = np.eye(4)
        affine[:3, :3] = self._rotation() * sides
        affine[:3, 3] = self["qoffset"]
        return affine

    @property
    def affine(self) -> NDArray[np.float64]:
        """Return what maps (i, j, k) to RAS+ in the file's unit: by sform, else qform, else the center at 0.

        Raises
        ------
        ValueError
            If the quaternion is longer than 1.
        """
        qform, sform = self.codes
        if sform:
            return self.sform
        if qform:
            return self.qform
        lengths = mended_sides(self.pixdim) * (-1.0, 1.0, 1.0)  # columns run towards the patient's left
        affine = np.diag([*lengths, 1.0])
        affine[:3, 3] = -(np.array([*self.sides, 1, 1][:3]) - 1) / 2.0 * lengths
        return affine

    def _rotation(self) -> NDArray[np.longdouble]:
        """Return the matrix of the quaternion, whose first number is left out: the length of all four is 1."""
        x, y, z = np.array(self["quatern"], np.longdouble)
        rest = 1.0 - (x * x + y * y + z * z)
        nearly_0 = abs(rest) < 3 * np.finfo(PRECISION[self.version]).eps
        if not (nearly_0 or rest >= 0):
            raise ValueError(f"a quaternion of the square length {float(1.0 - rest):g}, which is more than 1")
        w = np.sqrt(0 if nearly_0 else rest)
        twice = 2.0 / (w * w + x * x + y * y + z * z)
        x2, y2, z2 = x * twice, y * twice, z * twice
        return np.array(
            [
                [1.0 - (y * y2 + z * z2), x * y2 - w * z2, x * z2 + w * y2],
                [x * y2 + w * z2, 1.0 - (x * x2 + z * z2), y * z2 - w * x2],
                [x * z2 - w * y2, y * z2 + w * x2, 1.0 - (x * x2 + y * y2)],
            ]
        )


def mended_sides(pixdim: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance between samples along each axis (3,), above 0: 1 where the header has 0.

    Examples
    --------
    >>> mended_sides(np.array([0.5, -0.5, 0.0])).tolist()
    [0.5, 0.5, 1.0]
    """
    sides = np.abs(pixdim)
    return np.where(sides == 0.0, 1.0, sides)


def nifti_header(content: bytes) -> NiftiHeader:
    """Return the header with which a file begins; more bytes may follow.

    Raises
    ------
    ValueError
        If it is none.
    """
    version = int(SIZES[1] in (int.from_bytes(content[:4], order) for order in ("little", "big")))
    if len(content) < SIZES[version]:
        raise ValueError(f"it ends after {len(content)} of the {SIZES[version]} bytes of its header")
    header = NiftiHeader(content[: SIZES[version]], version, "<")
    if not 0 <= header["dim"][0] <= 7:
        header = NiftiHeader(header.content, version, ">")
    (magic,), (code,), ends = header["magic"], header["datatype"], header["eol_check"]
    if magic not in MAGIC[version]:
        raise ValueError(f"magic string {magic.rstrip(bytes(1)).decode('latin1')!r} is not valid")
    if code not in TYPES:
        raise ValueError(f"data code {code} not supported")
    if any(ends) and ends != LINE_ENDS[version]:
        raise ValueError("its ends of lines were changed, as a transfer as text does")
    return header
