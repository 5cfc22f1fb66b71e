"""What a script touches: `ctmc ...`, `python -m ctmc_addon ...` and `blender -b --command ctmc ...`."""

from .main import main

__all__ = ["main"]
