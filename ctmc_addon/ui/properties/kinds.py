# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's properties with name, description and our translation context.

As in all modules of properties, `bpy` itself must not stand here: see settings.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bpy import props

from ..translations import OURS


def in_our_context(kind: Callable[..., Any]) -> Callable[..., Any]:
    """Return a kind of property that takes its name and description first."""

    def make(name: str, description: str, **options: Any) -> Any:
        return kind(name=name, description=description, translation_context=OURS, **options)

    return make


boolean = in_our_context(props.BoolProperty)
booleans = in_our_context(props.BoolVectorProperty)
collection = in_our_context(props.CollectionProperty)
choice = in_our_context(props.EnumProperty)
decimal = in_our_context(props.FloatProperty)
decimals = in_our_context(props.FloatVectorProperty)
integer = in_our_context(props.IntProperty)
integers = in_our_context(props.IntVectorProperty)
text = in_our_context(props.StringProperty)
