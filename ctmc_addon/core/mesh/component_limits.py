# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules for which components of a surface stay. A new one goes here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..measures.units import volume_text


class ComponentLimits(NamedTuple):
    """Conditions that a component must meet to stay.

    Parameters
    ----------
    largest : int
        Keep this many with their cavities; 0 keeps all. A component counts by what its outer wall encloses, equal ones
        in the order of their numbers.
    min_volume : float
        Drop components and fill cavities below it, mm3 of a surface in mm; applied together with `largest`. A cavity
        with no component around it, as may be where the surface is open, counts as a component.
    """

    largest: int = 0
    min_volume: float = 0.0

    @property
    def keep_all(self) -> bool:
        """Whether every component stays, whatever it encloses."""
        return self.largest == 0 and self.min_volume <= 0

    def need_no_volumes(self, count: int) -> bool:
        """Return whether `count` components all stay without measuring them."""
        return self.min_volume <= 0 and count <= self.largest

    def ask_more_than(self, applied: ComponentLimits) -> bool:
        """Return whether a surface that was kept by `applied` may lose components by these."""
        fewer = bool(self.largest) and not 0 < applied.largest <= self.largest
        return applied.min_volume < self.min_volume or fewer

    def kept(self, volumes: NDArray[np.float64], owner: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which components stay.

        Parameters
        ----------
        volumes : (components,) float64
            Volume of each, mm3; negative for a cavity.
        owner : (components,) intp
            The component that each is a cavity of, else itself.

        Raises
        ------
        MeshError
            If nothing would be left.
        """
        sizes, bodies = np.abs(volumes), owner == np.arange(len(owner))
        keep = sizes >= self.min_volume
        if not keep[bodies].any():
            raise MeshError(
                f"no component has a volume of {volume_text(self.min_volume)} or more: the largest of {bodies.sum()} "
                f"has {volume_text(float(sizes[bodies].max()))}; lower the minimum volume"
            )
        if self.largest:
            keep[np.flatnonzero(bodies)[np.argsort(-sizes[bodies], kind="stable")[self.largest :]]] = False
        return np.asarray(keep & keep[owner])
