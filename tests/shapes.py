# SPDX-License-Identifier: GPL-3.0-or-later
"""Values with a closed form, on the samples of a volume: (slices, rows, columns)."""

import numpy as np


def distance_mm(shape, center=None, spacing=(1.0, 1.0, 1.0)):
    """Distance of every sample from a point, millimetres.

    Parameters
    ----------
    shape : (slices, rows, columns)
    center : (x, y, z), optional
        In samples; the middle of the volume by default.
    spacing : (x, y, z)
        Millimetres between samples.

    Returns
    -------
    (slices, rows, columns) float64
    """
    x, y, z = ((n - 1) / 2 for n in shape[::-1]) if center is None else center
    dx, dy, dz = spacing
    k, j, i = np.ogrid[tuple(slice(n) for n in shape)]
    return np.sqrt((dx * (i - x)) ** 2 + (dy * (j - y)) ** 2 + (dz * (k - z)) ** 2)
