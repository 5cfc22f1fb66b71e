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
    """

    HU = "HU"
    GRAY = "gray value"
    LABEL = "label"

    @property
    def plural(self) -> str:
        """Return the kind in the plural, for a message."""
        return str(self) if self is ValueKind.HU else f"{self}s"

    @classmethod
    def _missing_(cls, value: object) -> ValueKind | None:
        """Accept the spelling of version 0.2."""
        return cls.GRAY if value == "grey value" else None
