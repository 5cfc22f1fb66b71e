# SPDX-License-Identifier: GPL-3.0-or-later
"""Lay out the table of a rotation test as table 2 of Su and Ma: rounds, average, saving in per cent."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RotationTable:
    """The times of a rotation test.

    Parameters
    ----------
    motion : str
        "rotate", "zoom" or "pan".
    percents : tuple of float
        Share of triangles removed at each level.
    faces : tuple of int
        Triangles of each level.
    rounds : tuple of tuple of float
        Seconds, a tuple for each level.
    """

    motion: str
    percents: tuple[float, ...]
    faces: tuple[int, ...]
    rounds: tuple[tuple[float, ...], ...]

    @property
    def averages(self) -> tuple[float, ...]:
        """Return the mean of the rounds of each level, seconds."""
        return tuple(sum(times) / len(times) for times in self.rounds)

    @property
    def savings(self) -> tuple[float, ...]:
        """Return the time saved against the first level, per cent."""
        first = self.averages[0] or 1.0
        return tuple(100.0 * (1.0 - mean / first) for mean in self.averages)

    def rows(self, round_name: str = "Round", average: str = "Average", saving: str = "Saving") -> list[list[str]]:
        """Return the table as text: a head, a row for each round, average, saving.

        Examples
        --------
        >>> table = RotationTable("rotate", (0.0, 90.0), (1000, 100), ((2.0, 4.0), (1.0, 2.0)))
        >>> for row in table.rows(): print(row)
        ['', '0 %', '90 %']
        ['Round 1', '2.000 s', '1.000 s']
        ['Round 2', '4.000 s', '2.000 s']
        ['Average', '3.000 s', '1.500 s']
        ['Saving', '0.0 %', '50.0 %']
        """
        out = [["", *(f"{percent:g} %" for percent in self.percents)]]
        for number, times in enumerate(zip(*self.rounds, strict=True), 1):
            out.append([f"{round_name} {number}", *(f"{seconds:.3f} s" for seconds in times)])
        out.append([average, *(f"{mean:.3f} s" for mean in self.averages)])
        out.append([saving, *(f"{share:.1f} %" for share in self.savings)])
        return out

    def csv(self) -> str:
        """Return the table with plain numbers, seconds, for a spreadsheet."""
        lines = [["removed_percent", *(f"{percent:g}" for percent in self.percents)]]
        lines.append(["triangles", *(str(count) for count in self.faces)])
        for number, times in enumerate(zip(*self.rounds, strict=True), 1):
            lines.append([f"round_{number}_s", *(f"{seconds:.6f}" for seconds in times)])
        lines.append(["average_s", *(f"{mean:.6f}" for mean in self.averages)])
        lines.append(["saving_percent", *(f"{share:.3f}" for share in self.savings)])
        return "\n".join(",".join(line) for line in lines) + "\n"
