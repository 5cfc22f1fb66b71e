# SPDX-License-Identifier: GPL-3.0-or-later
"""All settings of a reconstruction, with default, limits, unit and text, and which of them exclude each other.

The panel, the command line, the checks, the reports and the manual are made from these fields.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from .described import AUTO, Described, defaults, descriptions, setting
from .errors import SettingsError
from .measures.units import volume_text
from .smoothing.choices import (
    CHOICES,
    NONE,
    TEXT,
    done_smoothing,
    for_labels_text,
    has_width,
    is_for_gray,
    no_width_text,
)

GOALS = ("reduction", "target_faces", "max_error_mm")
EXCLUSIVE = (("threshold", "label"), ("upper", "label"), GOALS)
"""Groups of settings of which one at most may be given."""
DEFAULT_SMOOTHING_MM = 1.0
FIELD, EXTRACTION, ALPHA, COMPONENTS, SIMPLIFICATION = STAGES = (
    "field",
    "extraction",
    "alpha",
    "components",
    "simplification",
)
"""The stages of a reconstruction, in their order. Every setting belongs to one. A label's field depends on settings of
later stages too: on the stride, and on those in `Smoothing.reads`."""
RENAMED = {"soften_mm": "smoothing_mm"}
"""Settings of older files: 0 mm was no smoothing, of a label too, and is so still."""
INCOMPATIBLE = {"max_error_mm": ("simplifier", "decimate")}
"""Settings that one choice of another setting does not allow: Blender's Decimate has no error bound."""


@dataclass(frozen=True)
class ReconstructionSettings(Described):
    """Settings that say how to make a surface from a volume.

    Frozen, hashable and picklable. Every field's meaning, unit and limits stand in its `Setting`,
    see `SETTINGS`.

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
        "Gray value of the surface: voxels at or above it are inside. "
        "Larger = only denser tissue. Without it Otsu's threshold is used",
        label="Threshold",
        stage=EXTRACTION,
        unit="HU or gray value",
        start=200.0,
    )
    upper: float | None = setting(
        None,
        "Upper limit: values above it are outside too, such as -600 HU for lung between -950 and "
        "-600. Larger = more of the dense tissue. Without it there is no upper limit",
        label="Upper Limit",
        stage=EXTRACTION,
        unit="HU or gray value",
        start=1000.0,
    )
    label: int | None = setting(
        None,
        "Value of the structure in a label volume, reconstructed instead of a threshold",
        label="Label",
        stage=FIELD,
        type=int,
        start=1,
    )
    stride: tuple[int, int, int] = setting(
        (1, 1, 1),
        "Sides of a voxel along x, y and z, in pixels. Larger = fewer voxels to visit and fewer triangles",
        label="Stride",
        stage=EXTRACTION,
        unit="px",
        low=1,
        high=16,
        size=3,
        type=int,
    )
    alpha: float | str = setting(
        1.0,
        "alpha: 0 = edge midpoints, evenly shaped triangles; 1 = linear interpolation, most accurate. "
        "Has no effect on a label that is not smoothed, where every crossing is the midpoint",
        label="Alpha (Shape)",
        stage=ALPHA,
        low=0.0,
        high=1.0,
        words=(AUTO,),
        note="auto = the largest at which no triangle of the full surface has an angle below --min-angle",
    )
    min_angle_deg: float = setting(
        5.0,
        "Alpha auto is chosen so that no triangle of the full surface has an angle below this. "
        "Larger = more even triangles, for simulation and print, and a less accurate surface",
        label="Minimum Angle",
        stage=ALPHA,
        unit="degrees",
        low=0.0,
        high=60.0,
        low_open=True,
        flag="min-angle",
    )
    topology: str = setting(
        "classic",
        "How ambiguous voxels are cut: by the 15 classic cases, or exactly by the trilinear "
        "interpolant. Both give a closed surface",
        label="Topology",
        stage=EXTRACTION,
        caption="{} topology".format,
        choices=("classic", "trilinear"),
        type=str,
    )
    smoothing: str = setting(AUTO, TEXT, label="Smooth", stage=FIELD, choices=(AUTO, *CHOICES), type=str)
    smoothing_mm: float | None = setting(
        None,
        "Standard deviation of the Gaussian. Larger = smoother. 0 = none. Without it, 1 mm",
        label="Sigma",
        stage=FIELD,
        unit="mm",
        low=0.0,
        high=50.0,
        start=DEFAULT_SMOOTHING_MM,
    )
    slice_steps: int = setting(
        0,
        "Steps per slice for constrained smoothing; stride along z counts these steps. 1 = no added "
        "steps, 0 = automatic: enough that no voxel side is more than twice another, none if stride "
        "along z is above 1",
        label="Slice Steps",
        stage=FIELD,
        low=0,
        high=8,
        type=int,
    )
    interfaces: str = setting(
        "shared",
        "How touching labels meet. shared = along one surface, without gaps or overlaps; separate = "
        "each label is made on its own, and neighbors may overlap",
        label="Interfaces",
        stage=EXTRACTION,
        choices=("shared", "separate"),
        type=str,
    )
    close_border: bool = setting(
        False,
        "Close the surface where it meets the border of the volume or region with a cap half a pixel outside it",
        label="Close Border",
        stage=EXTRACTION,
        caption="closed at the border".format,
        type=bool,
    )
    region: tuple[float, float, float, float, float, float] | None = setting(
        None,
        "Box: lowest x, y, z, then highest x, y, z. A box in mm takes every voxel it touches",
        label="Region",
        stage=FIELD,
        caption="a region".format,
        unit="voxels or mm",
        size=6,
        start=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
    )
    region_unit: str = setting(
        "voxel",
        "Whether the region is given in voxel indices or in RAS+ millimeters",
        label="Region Unit",
        stage=FIELD,
        choices=("voxel", "mm"),
        choice_labels={"voxel": "Voxels", "mm": "mm"},
        type=str,
    )
    keep_parts: int = setting(
        0,
        "Keep this many of the largest connected components, each with its cavities. 0 = all",
        label="Keep Largest",
        stage=COMPONENTS,
        caption=lambda count: "largest component" if count == 1 else f"{count} largest components",
        low=0,
        high=1_000_000,
        type=int,
    )
    min_part_mm3: float = setting(
        0.0,
        "Drop connected components and fill cavities whose volume is below this. "
        "Larger = fewer small components. 0 = none",
        label="Minimum Volume",
        stage=COMPONENTS,
        caption=lambda least: f"components of {volume_text(least)} or more",
        unit="mm3",
        low=0.0,
        flag="min-part",
    )
    normals: str = setting(
        "gradient",
        "Where normals come from: the gradient of the gray values (smooth shading) or the mesh itself",
        label="Normals",
        stage=EXTRACTION,
        choices=("gradient", "mesh"),
        type=str,
    )
    simplifier: str = setting(
        "builtin",
        "Simplify by the built-in quadric error simplifier, by Blender's live Decimate modifier, or not at all",
        label="Simplifier",
        stage=SIMPLIFICATION,
        choices=("none", "builtin", "decimate"),
        choice_labels={"builtin": "Built-In"},
        type=str,
    )
    reduction: float | None = setting(
        None,
        "Share of the triangles to remove. Larger = fewer triangles",
        label="Rate",
        stage=SIMPLIFICATION,
        low=0.0,
        high=1.0,
        high_open=True,
        flag="simplify",
        start=0.9,
    )
    target_faces: int | None = setting(
        None,
        "Number of triangles to simplify to. Smaller = fewer triangles",
        label="Triangles",
        stage=SIMPLIFICATION,
        low=4,
        type=int,
        flag="triangles",
        start=10_000,
    )
    max_error_mm: float | None = setting(
        None,
        "Largest distance that simplification may move the surface. Larger = fewer triangles",
        label="Maximum Error",
        stage=SIMPLIFICATION,
        unit="mm",
        low=0.0,
        low_open=True,
        flag="max-error",
        start=0.5,
    )
    nan_as: float | None = setting(
        None,
        "Value that replaces NaN and infinite voxels",
        label="Replace NaN With",
        stage=FIELD,
        unit="HU or gray value",
        flag="nan-as",
        start=-1024.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for group in EXCLUSIVE:
            given = [f"{name} {getattr(self, name):g}" for name in group if getattr(self, name) is not None]
            if len(given) > 1:
                raise SettingsError(f"{' and '.join(given)} cannot be set together; choose one")
        for name in SETTINGS:
            if not is_allowed(self, name) and getattr(self, name) is not None:
                rival, choice = INCOMPATIBLE[name]
                raise SettingsError(f"{name} is not possible with {rival} {choice}; choose another {rival}")
        if self.threshold is not None and self.upper is not None and self.upper < self.threshold:
            raise SettingsError(f"upper {self.upper:g} is below threshold {self.threshold:g}; give the lower one first")
        if self.threshold is not None and not is_for_gray(self.smoothing):
            raise SettingsError(for_labels_text(self.smoothing))
        if self.smoothing_mm and self.smoothing != AUTO and not has_width(self.smoothing):
            raise SettingsError(no_width_text(self.smoothing, self.smoothing_mm))
        if self.region is not None:
            require_corners_in_order(self.region)

    @property
    def simplifies(self) -> bool:
        """Whether the settings give a goal and a simplifier that reaches it."""
        return self.simplifier != "none" and any(getattr(self, goal) is not None for goal in GOALS)

    @property
    def simplifies_here(self) -> bool:
        """Whether the built-in simplifier has a goal; Blender's modifier works later."""
        return self.simplifies and self.simplifier == "builtin"

    @property
    def drops_components(self) -> bool:
        """Whether small components are to be removed."""
        return bool(self.keep_parts or self.min_part_mm3)

    @property
    def looks_again(self) -> bool:
        """Whether the pieces of the full surface are read more than once."""
        return self.drops_components or self.alpha == AUTO

    @property
    def smoothing_method(self) -> str:
        """The smoothing that is done, by its name in `smoothing.choices`."""
        return done_smoothing(self.smoothing, self.smoothing_mm, self.label is not None)

    @property
    def smoothing_is_automatic(self) -> bool:
        """Whether nothing was said of smoothing."""
        return self.smoothing == AUTO and self.smoothing_mm is None

    @property
    def smoothing_width_mm(self) -> float:
        """The width of the smoothing, such as the standard deviation of a Gaussian; 0 where it has none."""
        if not has_width(self.smoothing_method):
            return 0.0
        return DEFAULT_SMOOTHING_MM if self.smoothing_mm is None else self.smoothing_mm

    @property
    def alpha_number(self) -> float:
        """The alpha, which a finished surface always has.

        Raises
        ------
        SettingsError
            If the surface is yet to decide.
        """
        if isinstance(self.alpha, str):
            raise SettingsError(f"alpha {self.alpha} depends on the surface; give a number from 0 to 1 here")
        return self.alpha

    @property
    def alpha_matters(self) -> bool:
        """Whether alpha has an effect: not on a label of 0 and 1, where every crossing is the midpoint."""
        return self.label is None or CHOICES[self.smoothing_method].graded

    def without(self, stage: str) -> ReconstructionSettings:
        """Return the settings with those of a stage at their defaults.

        Examples
        --------
        >>> ReconstructionSettings(threshold=200, reduction=0.9).without("simplification").reduction is None
        True
        """
        default = defaults(type(self))
        return replace(self, **{name: default[name] for name in settings_of_stage(stage)})

    @property
    def unsmoothed(self) -> ReconstructionSettings:
        """The settings without any smoothing."""
        return replace(self, smoothing=NONE, smoothing_mm=None)

    def at_threshold(self, threshold: float, upper: float | None = None) -> ReconstructionSettings:
        """Return the settings of a threshold's surface: smoothed as they say, if that smooths gray values."""
        smoothing = self.smoothing if is_for_gray(self.smoothing) else AUTO
        return replace(self, label=None, threshold=threshold, upper=upper, smoothing=smoothing)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ReconstructionSettings:
        """Return the settings of a dictionary as `to_dict` makes it; an unknown name is a `SettingsError`."""
        return super().from_dict(with_present_names(values))


SETTINGS = descriptions(ReconstructionSettings)
"""Every setting's name and description, in the order of the panel and the manual."""


def settings_of_stage(stage: str) -> tuple[str, ...]:
    """Return the names of the settings that belong to a stage.

    Examples
    --------
    >>> settings_of_stage("components")
    ('keep_parts', 'min_part_mm3')
    """
    return tuple(name for name, about in SETTINGS.items() if about.stage == stage)


def with_present_names(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings by name, those of older files by their present names.

    Examples
    --------
    >>> with_present_names({"label": 2, "soften_mm": 1.5})
    {'label': 2, 'smoothing_mm': 1.5}
    """
    return {RENAMED.get(name, name): value for name, value in values.items()}


def is_allowed(settings: Any, name: str) -> bool:
    """Return whether the other settings, of an object with their names, allow the setting `name` to be given."""
    rival, choice = INCOMPATIBLE.get(name, (name, None))
    return choice is None or getattr(settings, rival) != choice


def require_corners_in_order(region: Sequence[float]) -> None:
    """Raise `SettingsError` for a region whose highest corner is not above its lowest along every axis."""
    if any(region[axis] >= region[axis + 3] for axis in range(3)):
        raise SettingsError(f"region {tuple(region)} is empty; give the lowest x, y, z first, then the highest")
