"""Numbers as a person reads them, in panels and reports."""

from __future__ import annotations

from collections.abc import Sequence

SIDES = {"L": "left", "R": "right", "P": "back", "A": "front", "S": "head", "I": "feet"}


def count(number: int) -> str:
    """A count, its thousands parted.

    Examples
    --------
    >>> count(1234567)
    '1,234,567'
    """
    return f"{number:,}"


def size_of_bytes(number: float) -> str:
    """Bytes in MiB or GiB.

    Examples
    --------
    >>> size_of_bytes(3 * 2**20), size_of_bytes(1.5 * 2**30)
    ('3 MiB', '1.5 GiB')
    """
    return f"{number / 2**30:.1f} GiB" if number >= 2**30 else f"{max(1, round(number / 2**20))} MiB"


def duration(seconds: float) -> str:
    """Seconds, with no more digits than are known.

    Examples
    --------
    >>> duration(0.04), duration(3.21), duration(47.6), duration(200)
    ('0.1 s', '3.2 s', '48 s', '3.3 min')
    """
    if seconds >= 120:
        return f"{seconds / 60:.1f} min"
    return f"{seconds:.0f} s" if seconds >= 10 else f"{max(seconds, 0.1):.1f} s"


def voxel_sides(stride: Sequence[int], spacing: Sequence[float]) -> str:
    """Sides of a voxel in pixels and millimetres; equal ones are said once.

    Examples
    --------
    >>> voxel_sides((2, 2, 1), (0.745, 0.745, 2.0))
    'x y 2 px = 1.49 mm, z 1 px = 2 mm'
    """
    said: dict[str, str] = {}
    for axis, step, side in zip("xyz", stride, spacing, strict=True):
        text = f"{step} px = {step * side:.3g} mm"
        said[text] = f"{said[text]} {axis}" if text in said else axis
    return ", ".join(f"{axes} {text}" for text, axes in said.items())


def directions(orientation: str) -> tuple[str, str, str]:
    """Where columns, rows and slices run to.

    Examples
    --------
    >>> directions("LPS")
    ('left', 'back', 'head')
    """
    x, y, z = (SIDES[letter] for letter in orientation)
    return x, y, z


def in_lines(text: str, width: int) -> list[str]:
    """A sentence in lines of at most `width` letters; signs without spaces, such as Chinese, may break anywhere.

    Examples
    --------
    >>> in_lines("a threshold of 40 is low", 12)
    ['a threshold', 'of 40 is low']
    """
    lines, line = [], ""
    for word in text.split(" "):
        rest = word
        while len(rest) > width:
            lines += [line] if line else []
            line, rest = "", rest
            lines.append(rest[:width])
            rest = rest[width:]
        if line and len(line) + 1 + len(rest) > width:
            lines.append(line)
            line = rest
        else:
            line = f"{line} {rest}" if line else rest
    return [*lines, line] if line else lines
