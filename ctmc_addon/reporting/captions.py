# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the line of text under a figure."""

from __future__ import annotations

from collections.abc import Sequence

from ..core import SETTINGS, ReconstructionSettings, defaults, length_text, sizes_text, smoothing_of
from .formatting import capitalized


def figure_caption(
    settings: Sequence[ReconstructionSettings],
    spacing_mm: Sequence[float],
    threshold: float,
    triangles: int,
    name: str = "",
    unit: str = "",
    explode: float = 0.0,
) -> str:
    """Return every setting that shaped a figure's surface, in a line; of several surfaces, what they have in common.

    `spacing_mm` is empty where surfaces have different ones; `unit` is that of the threshold, HU or none. In an
    exploded view the farthest surface moves by `explode` mm.

    Examples
    --------
    >>> bone = ReconstructionSettings(threshold=200.0, stride=(2, 2, 1))
    >>> figure_caption([bone], (0.7, 0.7, 2), 200.0, 1234, unit="HU")
    'Surface at 200 HU, stride 2 × 2 × 1 px = 1.4 × 1.4 × 2 mm, alpha 1, 1,234 triangles'
    >>> figure_caption([ReconstructionSettings(label=1), ReconstructionSettings(label=2)], (), 0.5, 10)
    'Stride 1 px, constrained smoothing, alpha 1, 10 triangles'
    """
    first, phrases = settings[0], []
    if len(settings) == 1 and first.label is not None:
        phrases.append(name or f"Label {first.label}")
    elif len(settings) == 1:
        limits = f"at {threshold:.4g}" if first.upper is None else f"from {threshold:.4g} to {first.upper:.4g}"
        phrases.append(f"{name or 'Surface'} {limits} {unit}".rstrip())
    if all(surface.stride == first.stride for surface in settings):
        phrases.append(stride_phrase(first.stride, spacing_mm))
    smoothings = {smoothing_phrase(surface) for surface in settings}
    if len(smoothings) == 1 and "" not in smoothings:
        phrases += smoothings
    if all(surface.alpha_matters and surface.alpha == first.alpha for surface in settings):
        phrases.append(f"alpha {first.alpha_number:g}")
    for phrase in _shape_phrases(first):
        if all(phrase in _shape_phrases(surface) for surface in settings):
            phrases.append(phrase)
    if explode and len(settings) > 1:
        phrases.append(f"exploded by {length_text(explode)}")
    text = ", ".join([*phrases, f"{triangles:,} triangles"])
    return capitalized(text)


def _shape_phrases(settings: ReconstructionSettings) -> list[str]:
    """Return phrases for the steps that shaped a surface, in their order, without steps left at their defaults.

    Examples
    --------
    >>> _shape_phrases(ReconstructionSettings(close_border=True, keep_parts=1, reduction=0.9))
    ['closed at the border', 'largest component', 'simplified by 90 %']
    """
    phrases = []
    default = defaults(ReconstructionSettings)
    for name, about in SETTINGS.items():
        value = getattr(settings, name)
        if about.caption is not None and value != default[name]:
            phrases.append(about.caption(value))
    if settings.simplifies:
        how = "simplified"
        if settings.reduction is not None:
            how += f" by {settings.reduction * 100:.4g} %"
        elif settings.max_error_mm is not None:
            how += f" within {length_text(settings.max_error_mm)}"
        phrases.append(f"{how} (Decimate)" if settings.simplifier == "decimate" else how)
    return phrases


def stride_phrase(stride: Sequence[int], spacing_mm: Sequence[float] = ()) -> str:
    """Return a stride in pixels and, where the spacing is given, in mm, for a caption.

    Examples
    --------
    >>> stride_phrase((2, 2), (0.745, 0.745))
    'stride 2 px = 1.49 mm'
    """
    sides = [(step, step * side) for step, side in zip(stride, spacing_mm or stride, strict=True)]
    if len({(step, f"{side:.3g}") for step, side in sides}) == 1:
        sides = sides[:1]
    pixels, lengths = zip(*sides, strict=True)
    text = f"stride {' × '.join(map(str, pixels))} px"
    return f"{text} = {sizes_text(lengths, digits=3).replace(' x ', ' × ')}" if spacing_mm else text


def smoothing_phrase(settings: ReconstructionSettings) -> str:
    """Return the smoothing of a surface for a caption; empty for unsmoothed gray values.

    Examples
    --------
    >>> smoothing_phrase(ReconstructionSettings(label=2, smoothing_mm=1.5))
    'Gaussian of 1.5 mm'
    """
    smoothing = smoothing_of(settings)
    return smoothing.caption(settings) if settings.label is not None or smoothing.smooths else ""
