# SPDX-License-Identifier: GPL-3.0-or-later
"""Conditions of operators; each says why an operator cannot run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Needs:
    """An operator that can be pressed where all its needs are met; inherited before `bpy.types.Operator`.

    A need takes the operator's class, to leave its reason there, and the context.
    """

    needs: tuple[Callable[[Any, Any], bool], ...] = ()

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether all needs are met."""
        return all(need(cls, context) for need in cls.needs)
