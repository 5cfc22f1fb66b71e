# SPDX-License-Identifier: GPL-3.0-or-later
"""Two masks to one: what either, both, or the first alone has."""

from __future__ import annotations

from ...arrays import Flags
from ...errors import SettingsError

COMBINATIONS = ("or", "and", "minus")


def combined(first: Flags, second: Flags, how: str) -> Flags:
    """Return the union ("or"), intersection ("and") or difference ("minus") of two masks.

    Raises
    ------
    SettingsError
        If there is no such combination, or the masks have different shapes.

    Examples
    --------
    >>> import numpy as np
    >>> first, second = np.array([True, True, False]), np.array([True, False, True])
    >>> [combined(first, second, how).tolist() for how in COMBINATIONS]
    [[True, True, True], [True, False, False], [False, True, False]]
    """
    if first.shape != second.shape:
        raise SettingsError(
            f"masks of the shapes {first.shape} and {second.shape} cannot be combined; take both on one grid"
        )
    if how == "or":
        return first | second
    if how == "and":
        return first & second
    if how == "minus":
        return first & ~second
    raise SettingsError(f"masks are combined by {', '.join(COMBINATIONS)}, not '{how}'; choose one of these")
