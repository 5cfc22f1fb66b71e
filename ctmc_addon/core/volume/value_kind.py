# SPDX-License-Identifier: GPL-3.0-or-later
"""The kinds of values that a volume may hold."""

from __future__ import annotations

from enum import StrEnum


class ValueKind(StrEnum):
    """Meaning of a volume's values.

    Examples
    --------
    >>> ValueKind("gray value") is ValueKind("grey value") is ValueKind.GRAY
    True
    >>> ValueKind.DOSE.unit, ValueKind.SUV.unit, ValueKind.SUV.plural
    ('Gy', 'g/ml', 'SUVbw')
    """

    HU = "HU"
    SUV = "SUVbw"
    """Uptake of a tracer in PET, by body weight."""
    DOSE = "Gy"
    """Dose of radiotherapy."""
    GRAY = "gray value"
    LABEL = "label"

    @property
    def plural(self) -> str:
        """Return the kind in the plural, for a message."""
        return str(self) if self.unit else f"{self}s"

    @property
    def unit(self) -> str:
        """Return the unit of the values; empty where they have none."""
        return {ValueKind.HU: "HU", ValueKind.SUV: "g/ml", ValueKind.DOSE: "Gy"}.get(self, "")

    @property
    def mark(self) -> str:
        """Return the word behind a value in a text; empty where values have no unit."""
        return str(self) if self.unit else ""

    @property
    def is_sampled(self) -> bool:
        """Return whether values are measured at the voxels of labels on any other grid."""
        return self in (ValueKind.SUV, ValueKind.DOSE)

    @property
    def column(self) -> str:
        """Return the word that stands in the name of a table's column."""
        return {ValueKind.HU: "hu", ValueKind.SUV: "suv", ValueKind.DOSE: "gy"}.get(self, "gray")

    @classmethod
    def _missing_(cls, value: object) -> ValueKind | None:
        """Accept the spelling of version 0.2."""
        return cls.GRAY if value == "grey value" else None
