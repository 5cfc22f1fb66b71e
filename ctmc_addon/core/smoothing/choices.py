# SPDX-License-Identifier: GPL-3.0-or-later
"""The smoothings that settings offer: their names, and what settings check of them. The work is in `methods`."""

from __future__ import annotations

from typing import NamedTuple

from ..described import AUTO


class _SmoothingChoice(NamedTuple):
    """A smoothing, as settings know it.

    Parameters
    ----------
    for_gray : bool
        Whether it smooths gray values too; else labels alone.
    has_width : bool
        Whether its width is `smoothing_mm`; with a width of 0 nothing is smoothed.
    graded : bool
        Whether a label has values between inside and outside afterwards, so that alpha moves its vertices.
    """

    for_gray: bool = True
    has_width: bool = False
    graded: bool = True


NONE, WIDE, OF_LABEL = "none", "gaussian", "constrained"
"""Chosen by auto: for a threshold, with a width, for a label."""
CHOICES: dict[str, _SmoothingChoice] = {
    NONE: _SmoothingChoice(graded=False),
    WIDE: _SmoothingChoice(has_width=True),
    OF_LABEL: _SmoothingChoice(for_gray=False),
}
TEXT = (
    "Smoothing before extraction. constrained = the smoothest surface that keeps every sample of the "
    "label on its own side, and the volume; gaussian = a Gaussian filter, for gray values too, which "
    "removes small components; auto = constrained for a label, none for a threshold, gaussian if its "
    "width is given"
)


def done_smoothing(name: str, width_mm: float | None, of_label: bool) -> str:
    """Return the smoothing that is done where `name` is chosen.

    Examples
    --------
    >>> [done_smoothing("auto", width, of_label=True) for width in (None, 0.0, 1.5)]
    ['constrained', 'none', 'gaussian']
    """
    if width_mm is not None and (name == AUTO or has_width(name)):
        return NONE if width_mm == 0 else WIDE if name == AUTO else name
    if name == AUTO:
        return OF_LABEL if of_label else NONE
    return name


def has_width(name: str) -> bool:
    """Return whether `smoothing_mm` is the width of the smoothing of this name."""
    return name in CHOICES and CHOICES[name].has_width


def is_for_gray(name: str) -> bool:
    """Return whether a threshold may have the smoothing of this name."""
    return name == AUTO or CHOICES[name].for_gray


def for_labels_text(name: str) -> str:
    """Return why a threshold cannot be smoothed so, and the remedy.

    Examples
    --------
    >>> for_labels_text("constrained")
    'smoothing constrained is for labels; for a threshold choose smoothing gaussian or none'
    """
    alternatives = " or ".join(each for each in reversed(CHOICES) if CHOICES[each].for_gray)
    return f"smoothing {name} is for labels; for a threshold choose smoothing {alternatives}"


def no_width_text(name: str, width_mm: float) -> str:
    """Return why a smoothing cannot have a width, and the remedy.

    Examples
    --------
    >>> no_width_text("none", 1.5)
    'smoothing_mm 1.5 is the width of smoothing gaussian, and smoothing is none; choose one'
    """
    wide = " or ".join(each for each in CHOICES if CHOICES[each].has_width)
    return f"smoothing_mm {width_mm:g} is the width of smoothing {wide}, and smoothing is {name}; choose one"
