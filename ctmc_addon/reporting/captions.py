"""What is written under a figure, and lists of settings as a person types them for one."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..core import ReconstructionSettings, SettingsError


def figure_caption(settings: Sequence[ReconstructionSettings], threshold: float, triangles: int, name: str = "") -> str:
    """What is shown, in a line; of several surfaces, what they have in common.

    Examples
    --------
    >>> figure_caption([ReconstructionSettings(threshold=200.0, stride=(2, 2, 1))], 200.0, 1234)
    'Surface at 200, voxel sides 2 × 2 × 1 px, alpha 1, 1,234 triangles'
    >>> figure_caption([ReconstructionSettings(label=1), ReconstructionSettings(label=2)], 0.5, 10)
    'Voxel sides 1 × 1 × 1 px, 10 triangles'
    """
    first, said = settings[0], []
    if len(settings) == 1 and first.label is not None:
        said.append(name or f"Label {first.label}")
    elif len(settings) == 1:
        said.append(f"{name or 'Surface'} at {threshold:.4g}")
    if all(one.stride == first.stride for one in settings):
        said.append("voxel sides " + " × ".join(str(side) for side in first.stride) + " px")
    if all(one.alpha_matters and one.alpha == first.alpha for one in settings):
        said.append(f"alpha {first.alpha:g}")
    text = ", ".join([*said, f"{triangles:,} triangles"])
    return text[0].upper() + text[1:]


def side_of(word: str) -> tuple[int, int]:
    """Voxel sides in x and y, px.

    Examples
    --------
    >>> side_of("2"), side_of("2x1")
    ((2, 2), (2, 1))
    """
    match = re.fullmatch(r"(-?\d+)(?:x(\d+))?", word)
    if match is None:
        raise SettingsError(f"'{word}' is no voxel side; write 2, or 2x1 for x and y apart")
    x = int(match[1])
    return (x, x if match[2] is None else int(match[2]))


def parsed_sides(text: str) -> tuple[tuple[int, int], ...]:
    """Voxel sides in a line, each once.

    Examples
    --------
    >>> parsed_sides("1, 2x1 3")
    ((1, 1), (2, 1), (3, 3))
    """
    return tuple(dict.fromkeys(side_of(word) for word in words_of(text, "voxel sides", "1 2 3")))


def parsed_numbers(text: str, what: str, example: str) -> tuple[float, ...]:
    """Numbers in a line, each once; `what` they are and an `example` for whoever typed something else.

    Examples
    --------
    >>> parsed_numbers("0 0.25; 1", "alphas", "0 1")
    (0.0, 0.25, 1.0)
    """
    try:
        return tuple(dict.fromkeys(float(word) for word in words_of(text, what, example)))
    except ValueError as error:
        raise SettingsError(f"{what} are numbers such as {example}, not '{text}'") from error


def words_of(text: str, what: str, example: str) -> list[str]:
    """The words of a line, parted by blanks, commas or semicolons; at least one."""
    words = text.replace(",", " ").replace(";", " ").replace("%", " ").split()
    if not words:
        raise SettingsError(f"{what} to compare are missing; give some, such as {example}")
    return words
