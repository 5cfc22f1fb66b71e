# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps: quantities on the vertices of a surface, such as the thickness of a wall."""

from typing import TYPE_CHECKING

from ..later import lazy_names

if TYPE_CHECKING:
    from .angle import SmallestAngle as SmallestAngle
    from .deviation import Deviation as Deviation
    from .distance import DistanceTo as DistanceTo
    from .make import MAPPING as MAPPING, mapped_steps as mapped_steps
    from .painted import Painted as Painted
    from .quantities import QUANTITIES as QUANTITIES
    from .quantity import Inputs as Inputs, MappedSurface as MappedSurface, MapValues as MapValues, Quantity as Quantity
    from .ramps import (
        DIVERGING as DIVERGING,
        NO_VALUE as NO_VALUE,
        RAMPS as RAMPS,
        colors_of as colors_of,
        linear as linear,
        rgb_of as rgb_of,
        stops_of as stops_of,
    )
    from .request import MapRequest as MapRequest
    from .surface_map import (
        Limits as Limits,
        MapStatistics as MapStatistics,
        Point as Point,
        SurfaceMap as SurfaceMap,
        range_of as range_of,
        shares_beyond as shares_beyond,
        statistics_of as statistics_of,
        step_up as step_up,
        vertex_areas as vertex_areas,
    )
    from .thickness import Gap as Gap, Thickness as Thickness

__getattr__ = lazy_names(__name__)
