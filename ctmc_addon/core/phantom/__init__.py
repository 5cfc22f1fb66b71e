"""An abdominal CT with known truth."""

from .phantom import Phantom, phantom_steps

__all__ = [
    "Phantom",
    "phantom_steps",
]
