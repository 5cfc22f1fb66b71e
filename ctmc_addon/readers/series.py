# SPDX-License-Identifier: GPL-3.0-or-later
"""Describe a series: one of those in a DICOM folder, or the one volume of another file; no patient data."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..core import length_text, one_line


@dataclass(frozen=True)
class Series:
    """One series in a DICOM folder, or the one volume of another file; no patient data.

    Parameters
    ----------
    number : int
        1-based, in the natural order of the files.
    uid : str
        SeriesInstanceUID, empty where there is none.
    slices : int
        Images or frames at different positions, scouts included.
    size : (columns, rows) int
        Of most of its slices.
    modality : str
        Such as 'CT'; empty where the format has none.
    dtype : str
        NumPy's name for the type of the stored values.
    times : int
        Volumes at the same place: time points or cardiac phases.
    default_time : int
        The one that is read if none is asked for; the one with the most slices.
    dicom_number, description, kernel : str
        SeriesNumber, SeriesDescription and ConvolutionKernel, empty where there are none. For the screen alone: people
        write names into descriptions, so they stand in no name, note, report or file.
    spacing_mm : float or None
        Between slices, along their normal, where it is known.
    folder : str
        Name of the folder with its files, where those of the path lie in several; for the screen alone.
    """

    number: int
    uid: str
    slices: int
    size: tuple[int, int]
    modality: str = ""
    dtype: str = ""
    times: int = 1
    default_time: int = 1
    dicom_number: str = field(default="", repr=False)
    description: str = field(default="", repr=False)
    kernel: str = field(default="", repr=False)
    spacing_mm: float | None = None
    folder: str = field(default="", repr=False)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return (slices, rows, columns), as `Volume.values` has them unless slices are left out or resampled."""
        return (self.slices, self.size[1], self.size[0])

    @property
    def voxel_bytes(self) -> int:
        """Return the bytes of a stored value; 4 if its type is unknown."""
        return np.dtype(self.dtype or "f4").itemsize

    @property
    def text(self) -> str:
        """Return the series for notes and errors, without texts from files: 'series 2: 30 slices of 512 x 512, CT'."""
        end = f", {self.modality}" if self.modality else ""
        plural = "slice" if self.slices == 1 else "slices"
        times = f", {self.times} times" if self.times > 1 else ""
        return f"series {self.number}: {self.slices} {plural} of {self.size[0]} x {self.size[1]}{end}{times}"

    @property
    def screen_text(self) -> str:
        """Return `text` and the operator's description of the series; for the screen only, because it may hold a name.

        Examples
        --------
        >>> Series(2, "", 30, (512, 512), "CT", spacing_mm=1.5, dicom_number="4", description="Lung").screen_text
        'series 2: 30 slices of 512 x 512, CT, 1.5 mm apart, no. 4, Lung'
        """
        apart = "" if self.spacing_mm is None else f"{length_text(self.spacing_mm)} apart"
        number = f"no. {self.dicom_number}" if self.dicom_number else ""
        folder = f"in {self.folder}" if self.folder else ""
        parts = [self.text, apart, number, self.description, self.kernel, folder]
        return one_line(", ".join(part for part in parts if part))
