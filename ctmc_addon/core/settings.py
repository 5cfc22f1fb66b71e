"""Everything a reconstruction can be told, with default, limits, unit and text in one place.

The panel, the command line, the checks, the reports and the manual are made from these fields.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from .errors import SettingsError


@dataclass(frozen=True)
class Setting:
    """What is known of one field: the text and label a user reads, unit, limits, choices, size, flag."""

    text: str
    label: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    size: int = 1
    type: type = float
    flag: str = ""
    low_open: bool = False
    high_open: bool = False

    @property
    def limits(self) -> str:
        """The limits in words, for messages: 'from 0 to 1', 'of 0 or more'."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if self.low is None and self.high is None:
            return "a finite number"
        if self.high is None:
            return f"above {self.low:g}" if self.low_open else f"{self.low:g} or more"
        if self.high_open:
            return f"at least {self.low:g} and below {self.high:g}"
        return f"from {self.low:g} to {self.high:g}"


def setting(default: Any, text: str, **rest: Any) -> Any:
    """A dataclass field that describes itself; `rest` are fields of `Setting`."""
    return dataclasses.field(default=default, metadata={"setting": Setting(text, **rest)})


@dataclass(frozen=True)
class ReconstructionSettings:
    """How a surface is made from a volume.

    Frozen, hashable and picklable. Every field's meaning, unit and limits stand in its `Setting`,
    see `described`.

    Raises
    ------
    SettingsError
        If a value lies outside its limits or two settings contradict each other.

    Examples
    --------
    >>> ReconstructionSettings(threshold=200, stride=2).stride
    (2, 2, 2)
    """

    threshold: float | None = setting(
        None,
        "Grey value of the surface: voxels at or above it are inside. "
        "Larger = only denser tissue. Without it Otsu's threshold is used",
        label="Threshold",
        unit="HU or grey value",
    )
    label: int | None = setting(
        None,
        "Value of the structure in a label volume, reconstructed instead of a threshold",
        label="Label",
        type=int,
    )
    stride: tuple[int, int, int] = setting(
        (1, 1, 1),
        "Sides of a voxel along x, y and z, in pixels. Larger = fewer voxels to visit and fewer triangles",
        label="Voxel Sides",
        unit="px",
        low=1,
        high=16,
        size=3,
        type=int,
    )
    alpha: float = setting(
        1.0,
        "Smoothness: 0 puts vertices at edge midpoints (least distortion), 1 at the linear crossing (smoothest). "
        "Does nothing on a label that is not softened, where every crossing is the midpoint",
        label="Alpha",
        low=0.0,
        high=1.0,
    )
    topology: str = setting(
        "classic",
        "How ambiguous voxels are cut: by the 15 classic cases, or exactly as the trilinear interpolant has it. "
        "Both give a closed surface",
        label="Topology",
        choices=("classic", "trilinear"),
        type=str,
    )
    soften_mm: float = setting(
        0.0,
        "Standard deviation of a Gaussian blur of the label or the grey values before the surface is sought. "
        "Larger = smoother, and small parts vanish. 0 = none",
        label="Soften",
        unit="mm",
        low=0.0,
        high=50.0,
        flag="soften",
    )
    close_border: bool = setting(
        False,
        "Close the surface where it meets the border of the volume or region with a cap half a pixel outside it",
        label="Close Border",
        type=bool,
    )
    region: tuple[float, float, float, float, float, float] | None = setting(
        None,
        "Box to reconstruct: lowest x, y, z, then highest x, y, z. A box in mm takes every voxel it touches",
        label="Region",
        unit="voxels or mm",
        size=6,
    )
    region_unit: str = setting(
        "voxel",
        "Whether the region is given in voxel indices or in RAS+ millimetres",
        label="Region Unit",
        choices=("voxel", "mm"),
        type=str,
    )
    keep_parts: int = setting(
        0,
        "Keep this many of the largest connected parts, each with its cavities. 0 = all",
        label="Keep Largest",
        low=0,
        high=1_000_000,
        type=int,
    )
    min_part_mm3: float = setting(
        0.0,
        "Drop connected parts and fill cavities whose volume is below this. Larger = fewer specks. 0 = none",
        label="Smallest Part",
        unit="mm3",
        low=0.0,
        flag="min-part",
    )
    normals: str = setting(
        "gradient",
        "Where normals come from: the gradient of the grey values (smooth shading) or the mesh itself",
        label="Normals",
        choices=("gradient", "mesh"),
        type=str,
    )
    simplifier: str = setting(
        "builtin",
        "What meets the goal set by rate, triangles or error: the built-in quadric error simplifier, "
        "Blender's live Decimate modifier, or nothing",
        label="Simplifier",
        choices=("none", "builtin", "decimate"),
        type=str,
    )
    reduction: float | None = setting(
        None,
        "Share of the triangles to remove. Larger = fewer triangles",
        label="Rate",
        low=0.0,
        high=1.0,
        high_open=True,
        flag="simplify",
    )
    target_faces: int | None = setting(
        None,
        "Number of triangles to simplify to. Smaller = fewer triangles",
        label="Triangles",
        low=4,
        type=int,
        flag="triangles",
    )
    max_error_mm: float | None = setting(
        None,
        "Simplify as far as the surface moves at most this far. Larger = fewer triangles",
        label="Maximum Error",
        unit="mm",
        low=0.0,
        low_open=True,
        flag="max-error",
    )
    nan_as: float | None = setting(
        None,
        "Value to read NaN and infinite voxels as",
        label="Read NaN As",
        unit="HU or grey value",
        flag="nan-as",
    )

    def __post_init__(self) -> None:
        for name, about in described().items():
            object.__setattr__(self, name, checked(name, getattr(self, name), about))
        goals = [name for name in ("reduction", "target_faces", "max_error_mm") if getattr(self, name) is not None]
        if len(goals) > 1:
            raise SettingsError(f"{' and '.join(goals)} are set together; choose one goal for the simplifier")
        if self.simplifier == "decimate" and self.max_error_mm is not None:
            raise SettingsError(
                "Blender's Decimate knows no error bound; use the built-in simplifier with max_error_mm"
            )
        if self.threshold is not None and self.label is not None:
            raise SettingsError(f"threshold {self.threshold:g} and label {self.label} are set together; choose one")
        if self.region is not None and any(self.region[axis] >= self.region[axis + 3] for axis in range(3)):
            raise SettingsError(f"region {self.region} is empty; give the lowest x, y, z first, then the highest")

    @property
    def simplifies(self) -> bool:
        """Whether there is a goal and a simplifier to meet it."""
        goals = (self.reduction, self.target_faces, self.max_error_mm)
        return self.simplifier != "none" and any(goal is not None for goal in goals)

    @property
    def alpha_matters(self) -> bool:
        """False on a label without softening: its crossings are all midpoints."""
        return self.label is None or self.soften_mm > 0

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, strings and lists for JSON and TOML; settings that are None are left out."""
        values = {name: getattr(self, name) for name in described()}
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
            if value is not None
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ReconstructionSettings:
        """The inverse of `to_dict`; an unknown name is a `SettingsError`."""
        unknown = sorted(set(values) - set(described()))
        if unknown:
            raise SettingsError(f"unknown setting {unknown[0]!r}; the settings are {', '.join(described())}")
        return cls(**values)


def described(settings: type = ReconstructionSettings) -> dict[str, Setting]:
    """Every setting's name and description, in the order of the panel and the manual."""
    return {field.name: field.metadata["setting"] for field in dataclasses.fields(settings)}


def checked(name: str, value: Any, about: Setting) -> Any:
    """`value` in its own type, or a `SettingsError` with the value and the limits."""
    if value is None:
        default = next(field.default for field in dataclasses.fields(ReconstructionSettings) if field.name == name)
        if default is not None:
            raise SettingsError(f"{name} needs a value: {about.limits}")
        return None
    if about.size > 1:
        if isinstance(value, str) or not isinstance(value, (numbers.Real, Iterable)):
            raise SettingsError(f"{name} takes {about.size} numbers, not {value!r}")
        many = (value,) * about.size if isinstance(value, numbers.Real) else tuple(value)
        if len(many) != about.size:
            raise SettingsError(f"{name} takes {about.size} numbers, not {len(many)}: {value}")
        return tuple(checked_one(name, one, about) for one in many)
    return checked_one(name, value, about)


def checked_one(name: str, value: Any, about: Setting) -> Any:
    """One number, word or switch of a setting, in its own type and within its limits."""
    if about.type is str:
        if value not in about.choices:
            raise SettingsError(f"{name} is {about.limits}, not {value!r}")
        return str(value)
    if about.type is bool:
        if isinstance(value, str) or value not in (0, 1):
            raise SettingsError(f"{name} is on or off, True or False, not {value!r}")
        return bool(value)
    try:
        number = about.type(value)
        exact = number == float(value) and math.isfinite(number)
    except (TypeError, ValueError, OverflowError):
        exact = False
    if not exact:
        kind = "a whole number" if about.type is int else "a finite number"
        raise SettingsError(f"{name} must be {kind}, not {value!r}")
    too_low = about.low is not None and (number < about.low or (about.low_open and number == about.low))
    too_high = about.high is not None and (number > about.high or (about.high_open and number == about.high))
    if too_low or too_high:
        raise SettingsError(f"{name} must be {about.limits}, not {number:g}")
    return number
