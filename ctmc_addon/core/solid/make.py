# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the parts of a solid: surfaces of structures, what is done to their fields, and the parts' own surfaces."""

from __future__ import annotations

from collections.abc import Sequence

from ..machine.budget import Budget
from ..maps.quantity import Quantity
from ..maps.request import MapRequest
from ..progress import Steps, finish
from ..reconstruction import Reconstruction
from ..settings import ReconstructionSettings
from ..surfaces.request import SurfaceRequest
from ..volume.volume import Volume
from .request import SolidRequest


def solid_parts(
    volume: Volume,
    settings: ReconstructionSettings,
    solid: SolidRequest,
    labels: Sequence[int] = (),
    budget: Budget | None = None,
    maps: Sequence[Quantity] | MapRequest = (),
) -> list[Reconstruction]:
    """Make the parts of a solid.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
        Of the surfaces that the solid is made from, which are closed at the border; simplification is that of the
        parts.
    solid : SolidRequest
    labels : sequence of int
        Labels to make it of; by default the surface of the settings.
    budget : Budget, optional
    maps : sequence of Quantity or MapRequest
        Maps to make on the parts.

    Returns
    -------
    list of Reconstruction
        Parts, structure by structure; `label_name` is the name of the part, such as "hip a".

    Raises
    ------
    CtmcError
        With one sentence for the user.
    """
    from dataclasses import replace

    chosen = [replace(settings, threshold=None, label=label) for label in labels] or [settings]
    requests = [SurfaceRequest(each) for each in chosen]
    return finish(solid_parts_steps(volume, requests, solid, budget, maps=MapRequest.of(maps)))


def solid_parts_steps(
    volume: Volume,
    requests: Sequence[SurfaceRequest],
    solid: SolidRequest,
    budget: Budget | None = None,
    *,
    labels: Volume | None = None,
    maps: MapRequest | None = None,
) -> Steps[list[Reconstruction]]:
    """`solid_parts` as steps; closing the generator cancels. Sinks of the requests are ignored: all parts are held."""
    raise NotImplementedError
    yield
