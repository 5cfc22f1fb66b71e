# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the settings of the map that the active surface shows, `scene.ctmc_map`; the mesh stores them.

As in settings.py, this module must not hold `bpy` itself, nor anything that does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bpy.props import PointerProperty
from bpy.types import PropertyGroup, Scene
from bpy.utils import register_class, unregister_class

from ...core.maps import RAMPS
from .described import as_written
from .kinds import boolean, choice, decimal

RAMP_NAMES = tuple(RAMPS)


def _shown(properties: Any) -> Any:
    """Return the shown map; `maps` imports bpy, so it is looked up when needed."""
    from ..state.results import maps

    return maps.active_map(properties.id_data)


def _get_end(at: int) -> Callable[[Any], float]:
    def get(properties: Any) -> float:
        stored = _shown(properties)
        return float(at) if stored is None else float(stored.range[at])

    return get


def _set_end(at: int) -> Callable[[Any, float], None]:
    def put(properties: Any, value: float) -> None:
        from ..state.results import maps

        maps.set_end(properties.id_data, at, as_written(value))

    return put


def _get_ramp(properties: Any) -> int:
    stored = _shown(properties)
    return 0 if stored is None else RAMP_NAMES.index(stored.ramp)


def _set_ramp(properties: Any, number: int) -> None:
    from ..state.results import maps

    maps.change(properties.id_data, ramp=RAMP_NAMES[number])


def _get_limit(at: int) -> Callable[[Any], float]:
    def get(properties: Any) -> float:
        stored = _shown(properties)
        limit = None if stored is None else stored.limits[at]
        return limit if limit is not None else _get_end(at)(properties)

    return get


def _set_limit(at: int) -> Callable[[Any, float], None]:
    def put(properties: Any, value: float) -> None:
        from ..state.results import maps

        maps.set_limit(properties.id_data, at, as_written(value))

    return put


def _has_limit(at: int) -> Callable[[Any], bool]:
    def get(properties: Any) -> bool:
        stored = _shown(properties)
        return stored is not None and stored.limits[at] is not None

    return get


def _switch_limit(at: int) -> Callable[[Any, bool], None]:
    """Begin with a limit at the end of the colors."""

    def put(properties: Any, used: bool) -> None:
        from ..state.results import maps

        maps.set_limit(properties.id_data, at, as_written(_get_limit(at)(properties)) if used else None)

    return put


class CTMCMap(PropertyGroup):
    """The colors and limits of the map that the active surface shows."""

    low: decimal("From", "Value of the first color", precision=3, get=_get_end(0), set=_set_end(0))
    high: decimal("To", "Value of the last color", precision=3, get=_get_end(1), set=_set_end(1))
    ramp: choice(
        "Ramp",
        "Colors from the first value to the last",
        items=[(name, name.title(), "") for name in RAMP_NAMES],
        get=_get_ramp,
        set=_set_ramp,
    )
    use_lower: boolean(
        "Use Lower Limit", "Measure the share of the area below a limit", get=_has_limit(0), set=_switch_limit(0)
    )
    lower: decimal(
        "Lower Limit", "Smaller values are below the limit", precision=3, get=_get_limit(0), set=_set_limit(0)
    )
    use_upper: boolean(
        "Use Upper Limit", "Measure the share of the area above a limit", get=_has_limit(1), set=_switch_limit(1)
    )
    upper: decimal(
        "Upper Limit", "Larger values are above the limit", precision=3, get=_get_limit(1), set=_set_limit(1)
    )


def register() -> None:
    """Give every scene the settings of the shown map."""
    register_class(CTMCMap)
    Scene.ctmc_map = PointerProperty(type=CTMCMap, name="CTMC Map")


def unregister() -> None:
    """Unregister them."""
    del Scene.ctmc_map
    unregister_class(CTMCMap)
