# SPDX-License-Identifier: GPL-3.0-or-later
"""Roots, tangents and their angles with the same bits on every processor, for what decides a vertex or a tie.

`**`, `exp`, `tan` and their like come from the system's and NumPy's libraries, which choose among several versions by
the processor, and these differ in the last bit. Here are `+ - * /` in a fixed order, and powers of two.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

NEWTON_STEPS = 5  # The first guess is off by at most 0.08 of 1, and each step squares that.
TERMS = 12  # Of the series; at 60 degrees the next one is below 1e-24.


def cube_root(values: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return the cube roots of non-negative numbers, exact except for the last bits.

    Examples
    --------
    >>> cube_root(np.array([0.0, 0.125, 27.0, 1e300])).tolist()
    [0.0, 0.5, 3.0, 1e+100]
    """
    share, exponent = np.frexp(np.asarray(values, np.float64))
    third = -(-exponent // 3)
    share = np.ldexp(share, exponent - 3 * third)  # from 1/8 to 1
    root = (3.0 + 4.0 * share) / 7.0
    for _ in range(NEWTON_STEPS):
        root = (2.0 * root + share / (root * root)) / 3.0
    return np.where(share > 0, np.ldexp(root, third), 0.0)


def tangent(degrees: float) -> float:
    """Return the tangent of an angle from 0 to 60 degrees, by the series of sine and cosine.

    Examples
    --------
    >>> [round(tangent(degrees), 12) for degrees in (0.0, 30.0, 45.0)]
    [0.0, 0.57735026919, 1.0]
    """
    angle = degrees * (math.pi / 180.0)
    square = angle * angle
    sine = cosine = 1.0  # over the angle, the sine
    for number in range(TERMS, 0, -1):
        sine = 1.0 - sine * square / (2 * number * (2 * number + 1))
        cosine = 1.0 - cosine * square / ((2 * number - 1) * (2 * number))
    return angle * sine / cosine


LN_2 = 0.6931471805599453
SERIES_TERMS = 24  # Of both series; at their ends the next one is below 1e-17 of the sum.


def power_of_two(exponent: float) -> float:
    """Return 2 to the power of a number from -1000 to 1000, by the series of the exponential function.

    Examples
    --------
    >>> power_of_two(-3.0), round(power_of_two(0.5), 12)
    (0.125, 1.414213562373)
    """
    whole = math.floor(exponent + 0.5)
    part = (exponent - whole) * LN_2  # at most 0.35
    total = 1.0
    for number in range(SERIES_TERMS, 0, -1):
        total = 1.0 + total * part / number
    return math.ldexp(total, whole)


def natural_logarithm(number: float) -> float:
    """Return the natural logarithm of a number above 0, by the series of the inverse hyperbolic tangent.

    Examples
    --------
    >>> natural_logarithm(1.0), round(natural_logarithm(10.0), 12)
    (0.0, 2.302585092994)
    """
    share, exponent = math.frexp(number)  # from 0.5 to 1
    if share < 0.7:
        share, exponent = 2 * share, exponent - 1
    ratio = (share - 1.0) / (share + 1.0)  # at most 0.18
    square, total = ratio * ratio, 0.0
    for odd in range(2 * SERIES_TERMS + 1, 0, -2):
        total = total * square + 1.0 / odd
    return exponent * LN_2 + 2.0 * ratio * total


def arctangents(tangents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles of non-negative tangents, radians, exact except for the last bits.

    Three times the half of the angle is taken, tan(x / 2) = t / (1 + sqrt(1 + t^2)), then the series.

    Examples
    --------
    >>> np.degrees(arctangents(np.array([0.0, 1.0, 3.0**0.5]))).round(12).tolist()
    [0.0, 45.0, 60.0]
    """
    eighth = np.asarray(tangents, np.float64)
    for _ in range(3):
        eighth = eighth / (1.0 + np.sqrt(1.0 + eighth * eighth))
    square = eighth * eighth
    sums = np.zeros_like(eighth)
    for number in range(TERMS, -1, -1):
        sums = 1.0 / (2 * number + 1) - sums * square
    return np.asarray(8.0 * eighth * sums)
