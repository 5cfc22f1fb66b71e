# SPDX-License-Identifier: GPL-3.0-or-later
"""Wrap Blender's properties with name, description and our translation context.

As in all modules of properties, `bpy` itself must not stand here: see settings.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bpy import props

from ..translations import OURS


def _in_our_context(kind: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a kind of property so that it takes its name and description first."""

    def make(name: str, description: str, **options: Any) -> Any:
        return kind(name=name, description=description, translation_context=OURS, **options)

    return make


boolean = _in_our_context(props.BoolProperty)
booleans = _in_our_context(props.BoolVectorProperty)
collection = _in_our_context(props.CollectionProperty)
choice = _in_our_context(props.EnumProperty)
decimal = _in_our_context(props.FloatProperty)
decimals = _in_our_context(props.FloatVectorProperty)
integer = _in_our_context(props.IntProperty)
integers = _in_our_context(props.IntVectorProperty)
text = _in_our_context(props.StringProperty)
