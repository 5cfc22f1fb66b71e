# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids: operations on the fields of structures before parts are extracted, such as a hollow or a cut."""

from typing import TYPE_CHECKING

from ..later import lazy_names

if TYPE_CHECKING:
    from .cost import SolidCost as SolidCost, solid_cost as solid_cost
    from .fields.lattice import Lattice as Lattice
    from .fields.shapes import Bar as Bar, HalfSpace as HalfSpace, Shape as Shape
    from .make import MadeParts as MadeParts, solid_parts as solid_parts, solid_parts_steps as solid_parts_steps
    from .placed import (
        PlacedBars as PlacedBars,
        placed_cuts_pegs_steps as placed_cuts_pegs_steps,
        placed_drains_steps as placed_drains_steps,
    )
    from .placing.drains import auto_diameter as auto_diameter
    from .placing.outlines import moved_to as moved_to, position_of as position_of, rectangle_of as rectangle_of
    from .printing.print_facts import (
        PrintFacts as PrintFacts,
        cuts_to_fit as cuts_to_fit,
        print_facts_steps as print_facts_steps,
    )
    from .printing.printed import PRINTING as PRINTING, printed_steps as printed_steps
    from .printing.walls import Walls as Walls, walls_steps as walls_steps
    from .request import (
        LARGEST_MM as LARGEST_MM,
        LENGTHS as LENGTHS,
        MOST_CUTS as MOST_CUTS,
        MOST_PEGS as MOST_PEGS,
        Combination as Combination,
        Combining as Combining,
        Cut as Cut,
        Drain as Drain,
        Pegs as Pegs,
        SolidRequest as SolidRequest,
    )

__getattr__ = lazy_names(__name__)
