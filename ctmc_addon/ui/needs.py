# SPDX-License-Identifier: GPL-3.0-or-later
"""Check conditions of operators; each says why an operator cannot run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Needs:
    """An operator that can run if all its needs are met; inherited before `bpy.types.Operator`.

    A need takes the operator's class, on which it sets its reason, and the context.
    """

    needs: tuple[Callable[[Any, Any], bool], ...] = ()

    @classmethod
    def poll(cls, context: Any) -> bool:
        return all(need(cls, context) for need in cls.needs)
