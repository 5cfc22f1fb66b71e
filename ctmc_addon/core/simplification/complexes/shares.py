# SPDX-License-Identifier: GPL-3.0-or-later
"""Every label keeps the same share of its triangles, as if it were simplified alone.

By cost alone the smooth labels of a complex would give nearly all triangles, and lose more than alone. So costs are
multiplied by a weight for each interface, which falls where a label lags behind and rises where it runs ahead: a
controller with a proportional and an integral part, in octaves. Between two labels it is the mean of both, of which
each then has the triangles where it needs them most, on whichever interface.

Lines and borders need triangles at any rate. Where labels with many of them cannot give their share, the others give
more, but not without end: a label that is down to `least_share` of its share gives no more.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Doubles, Ints
from ..policy import POLICY, Policy


class Shares:
    """The triangles of every label at first and now.

    Parameters
    ----------
    labels : (2, interfaces) int32
        The two labels of each interface; 0 has no share.
    interface : (F,) int32
        Number of the interface that each triangle is in.
    asked : float
        Share of the triangles to keep.
    policy : Policy, optional
    """

    def __init__(self, labels: Ints, interface: Ints, asked: float, policy: Policy = POLICY) -> None:
        self.policy = policy
        self.labels = np.unique(labels[labels != 0])
        self.member = np.stack([(labels == label).any(axis=0) for label in self.labels]).astype(np.float64)
        self.counts = (self.member * np.bincount(interface, minlength=labels.shape[1])).sum(axis=1)
        self.total = len(interface)
        self.sum = np.zeros(len(self.labels))
        self.weight = np.ones(labels.shape[1], np.float32)
        self.closed = np.zeros(labels.shape[1], bool)  # interfaces that give no more
        self.least = policy.least_share * asked

    def update(self, interface: Ints) -> None:
        """Weigh the interfaces by the present triangles, (f,) numbers of interfaces."""
        if len(self.labels) == 1:
            return
        now = np.bincount(interface, minlength=len(self.weight))
        shares = (self.member * now).sum(axis=1) / self.counts
        lag = octaves(shares * (self.total / max(1, len(interface))))
        most = self.policy.most_octaves
        self.sum = np.clip(self.sum + self.policy.integral * lag, -most, most)
        offset = np.clip(self.policy.proportional * lag + self.sum, -most, most)
        mean = (offset[:, None] * self.member).sum(axis=0) / self.member.sum(axis=0)
        self.closed = (self.member[shares >= self.least] == 0).all(axis=0)
        self.weight = _power_of_two(-mean).astype(np.float32)


def octaves(ratios: Doubles) -> Doubles:
    """Logarithms to the base 2, straight lines between powers of two: the same bits on every machine.

    Examples
    --------
    >>> octaves(np.array([0.5, 1.0, 1.5, 2.0])).tolist()
    [-1.0, 0.0, 0.5, 1.0]
    """
    mantissa, exponent = np.frexp(np.maximum(ratios, np.finfo(np.float64).tiny))
    return exponent - 1 + (2.0 * mantissa - 1.0)


def _power_of_two(octave: Doubles) -> Doubles:
    """Return the ratios of which these are the `octaves`.

    Examples
    --------
    >>> _power_of_two(np.array([-1.0, 0.0, 0.5, 1.0])).tolist()
    [0.5, 1.0, 1.5, 2.0]
    """
    whole = np.floor(octave)
    return np.ldexp(1.0 + (octave - whole), whole.astype(np.int32))
