# SPDX-License-Identifier: GPL-3.0-or-later
"""Multiply vectors in columns, with a row for each coordinate, several times faster than `numpy.cross`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def cross(u: NDArray[Any], v: NDArray[Any]) -> NDArray[Any]:
    """Cross products of the columns of two (3, n) arrays, (3, n)."""
    out = np.empty_like(u)
    out[0] = u[1] * v[2] - u[2] * v[1]
    out[1] = u[2] * v[0] - u[0] * v[2]
    out[2] = u[0] * v[1] - u[1] * v[0]
    return out


def dot(u: NDArray[Any], v: NDArray[Any]) -> NDArray[Any]:
    """Dot products of the columns of two (3, n) arrays, (n,)."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
