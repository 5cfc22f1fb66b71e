"""The rotation test of Su and Ma, 4.3: how long a surface takes to turn once."""

from .offscreen import can_draw

__all__ = [
    "can_draw",
]
