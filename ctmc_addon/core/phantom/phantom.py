# SPDX-License-Identifier: GPL-3.0-or-later
"""An abdominal CT with known truth: body, liver, spine, ribs and irregular tumors, from a seed.

Shapes live in patient millimeters about the middle of the stack: x to the left, y to the back, z to the
head. A slice is the mean over its thickness, as a scanner's is: a voxel that a surface cuts has HU of both sides.
Only + - * / sqrt, whole numbers and halves decide a voxel, so every machine makes the same volume.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError
from ..machine.memory import require
from ..progress import Step, Steps, finish
from ..volume.affine import SPACING_LIMITS, is_spacing
from ..volume.value_kind import ValueKind
from ..volume.volume import Volume
from .shapes import grow_tumors, liver_shape

FIELD_MM = 379.0  # The anatomy is drawn for this field of view; other fields scale it.
LIVER, TUMOR = 1, 2

# HU of a portal venous phase
AIR, SKIN, FAT, MUSCLE, VISCERA = -1000, 30, -100, 55, 20
LIVER_HU, TUMOR_HU, AORTA_HU = 115, 55, 160
CORTICAL, SPONGY, DISC, CANAL, RIB = 600, 220, 90, 30, 450


@dataclass(frozen=True, eq=False)
class Phantom:
    """A CT, its labels and its truth.

    Parameters
    ----------
    volume : Volume
        (slices, size, size) int16 HU, axes towards the patient's left, back and head (LPS). Slices touch, and each is
        the mean over its thickness.
    labels : Volume
        uint8 on the same grid: 0 background, 1 liver, 2 tumor, as in LiTS. A voxel has the label of its center,
        also where its HU are a mixture.
    tumour_volumes_mm3 : tuple of float
        True volume of every tumor, largest first: the integral of its analytic surface over the sphere of
        directions, exact to rounding. Counting labeled voxels gives another number, `counted_mm3`, which
        comes nearer the finer the grid is.
    liver_volume_mm3 : float
        True volume of the liver with its tumors, as far as it lies within the stack.
    tumour_centres_ras_mm : tuple of (x, y, z) float
        In the order of the volumes.
    seed : int
        Seed of the random numbers.
    """

    volume: Volume
    labels: Volume
    tumour_volumes_mm3: tuple[float, ...]
    liver_volume_mm3: float
    tumour_centres_ras_mm: tuple[tuple[float, float, float], ...]
    seed: int

    def counted_mm3(self, label: int = TUMOR) -> float:
        """Return the number of voxels with this label times the volume of a voxel."""
        x, y, z = self.volume.spacing
        return int(np.count_nonzero(self.labels.values == label)) * x * y * z


def phantom(
    slices: int = 29, size: int = 512, spacing: tuple[float, float, float] | None = None, seed: int = 0
) -> Phantom:
    """Make an abdominal CT with known truth.

    Parameters
    ----------
    slices : int
        3 or more. From 4 slices on no tumor reaches the first or the last one.
    size : int
        Rows and columns, 16 or more.
    spacing : (x, y, z) float, millimeters
        By default the field of view is that of 512 pixels of 0.74 mm, and the slices are 5 mm apart or as
        near as it takes to cover 145 mm, but not below 0.5 mm. The anatomy is drawn in proportion to the
        field of view.
    seed : int
        0 or more. The same seed gives the same bytes everywhere.

    Returns
    -------
    Phantom
        Every tumor lies within the liver and is labeled in at least two neighboring slices.

    Raises
    ------
    SettingsError
        If a number is outside its limits.
    MemoryLimitError
        If it would not fit.

    Examples
    --------
    >>> ct = phantom(slices=5, size=64)
    >>> ct.volume.values.shape, ct.volume.orientation, sorted(set(ct.labels.values.ravel().tolist()))
    ((5, 64, 64), 'LPS', [0, 1, 2])
    """
    return finish(phantom_steps(slices, size, spacing, seed))


def phantom_steps(
    slices: int = 29, size: int = 512, spacing: tuple[float, float, float] | None = None, seed: int = 0
) -> Steps[Phantom]:
    """Return the same as `phantom`, a slice a step."""
    spacing = _checked_grid(slices, size, spacing, seed)
    require(3 * slices * size * size, f"a phantom of {slices} slices of {size} x {size}", "make it smaller")
    axes = [centered(size, spacing[0]), centered(size, spacing[1]), centered(slices, spacing[2])]
    scale = min(spacing[0], spacing[1]) * size / FIELD_MM
    rng = np.random.Generator(np.random.PCG64(seed))
    liver = liver_shape(rng, scale, spacing[2])
    tumors = grow_tumors(rng, liver, scale, spacing, axes)

    values = np.empty((slices, size, size), np.int16)
    labels = np.zeros((slices, size, size), np.uint8)
    background = Background(axes[0], axes[1], scale)
    for k, z in enumerate(axes[2].tolist()):
        yield Step(k / slices, "Making the phantom")
        tissue = background.in_slice(z, spacing[2])
        for label, shape in [(LIVER, liver), *((TUMOR, tumor) for tumor in tumors)]:
            rows, columns = (slice(*np.searchsorted(axes[axis], shape.box(axis)).tolist()) for axis in (1, 0))
            inside, share = shape.in_slice(axes[0][columns], axes[1][rows], z, spacing[2])
            labels[k, rows, columns][inside] = label
            window = tissue[rows, columns]
            # A tumor takes the place of liver.
            window += share * (LIVER_HU - window if label == LIVER else TUMOR_HU - LIVER_HU)
        values[k] = scanned(tissue, np.random.Generator(np.random.PCG64([seed, k])))

    affine = np.diag([-spacing[0], -spacing[1], spacing[2], 1.0])
    affine[:3, 3] = -axes[0][0], -axes[1][0], axes[2][0]
    half_height = slices * spacing[2] / 2
    return Phantom(
        volume=Volume(values, affine, name=f"volume-{seed}", kind=ValueKind.HU),
        labels=Volume(
            labels,
            affine,
            name=f"segmentation-{seed}",
            kind=ValueKind.LABEL,
            label_names={LIVER: "liver", TUMOR: "tumor"},
        ),
        tumour_volumes_mm3=tuple(round(tumor.volume_mm3(), 3) for tumor in tumors),
        liver_volume_mm3=round(liver.volume_mm3(half_height), 3),
        tumour_centres_ras_mm=tuple((-t.center[0], -t.center[1], t.center[2]) for t in tumors),
        seed=seed,
    )


def _checked_grid(
    slices: int, size: int, spacing: tuple[float, float, float] | None, seed: int
) -> tuple[float, float, float]:
    """Return the spacing, mm; raise a `SettingsError` for a grid outside its limits."""
    if slices < 3:
        raise SettingsError(f"a phantom needs 3 slices or more, not {slices}, for a tumor to be in two of them")
    if size < 16:
        raise SettingsError(f"a phantom needs 16 rows and columns or more, not {size}")
    if seed < 0:
        raise SettingsError(f"a seed is 0 or more, not {seed}")
    if spacing is None:
        pixel = 0.74 * 512 / size
        return (pixel, pixel, max(0.5, min(5.0, 145 / slices)))
    if len(spacing) != 3 or not is_spacing(spacing):
        raise SettingsError(f"spacing is three lengths {SPACING_LIMITS}, not {spacing}")
    return (float(spacing[0]), float(spacing[1]), float(spacing[2]))


def centered(count: int, gap: float) -> NDArray[np.float64]:
    """Return the positions of `count` samples centered at zero, mm."""
    return (np.arange(count) - (count - 1) / 2) * gap


class Background:
    """Everything but the liver: body wall, ribs, spine and aorta, (rows, columns) float64 HU a slice."""

    def __init__(self, x: NDArray[np.float64], y: NDArray[np.float64], scale: float) -> None:
        self.x, self.y = x[None, :] / scale, y[:, None] / scale  # of a body in a field of view of 379 mm
        self.scale = scale
        girth = (self.x / 165.0) ** 2 + (self.y / 118.0) ** 2  # 1 at the skin, (rows, columns)
        self.wall = np.nonzero((girth > 0.66) & (girth < 0.76) & (self.y > -75) & (np.abs(self.x) > 30))
        # The body is a little slimmer half-way up. A layer is where girth < limit * (1 - 0.05 / (1 + (z / 80)^2)),
        # that is where |z| > start; most pixels are in it everywhere or nowhere.
        self.layers = np.full(girth.shape, float(AIR))
        self.rims = []
        for limit, step in zip((1.0, 0.97, 0.80, 0.66), np.diff([AIR, SKIN, FAT, MUSCLE, VISCERA]), strict=True):
            spare = 1 - girth / limit
            start = 80 * np.sqrt(np.maximum(0.05 / np.where(spare > 0, spare, 1.0) - 1, 0))
            self.layers[(spare > 0) & (start == 0)] += step
            rim = np.nonzero((spare > 0) & (start > 0))
            self.rims.append((rim, start[rim], step))

    def in_slice(self, z_mm: float, thickness_mm: float) -> NDArray[np.float64]:
        """Return the mean HU over a slice whose middle is at height `z_mm`, without blur in the slice or noise."""
        z, thickness = z_mm / self.scale, thickness_mm / self.scale
        low, high = z - thickness / 2, z + thickness / 2
        tissue = self.layers.copy()
        for rim, start, step in self.rims:
            tissue[rim] += step * (1 - (np.clip(high, -start, start) - np.clip(low, -start, start)) / (high - low))
        # Ribs run down towards the front, 28 mm apart.
        down = 0.6 * self.y[:, 0]
        rib = _share_near_whole((low - down) / 28.0, (high - down) / 28.0, 0.2)  # (rows,)
        tissue[self.wall] += rib[self.wall[0]] * (RIB - MUSCLE)
        self.add_spine(tissue, float(_share_near_whole(np.array(low / 32.0), np.array(high / 32.0), 3.5 / 32.0)))
        self.add_disc(tissue, (18.0, 38.0), (11.0, 11.0), AORTA_HU)
        return tissue

    def add_spine(self, tissue: NDArray[np.float64], between: float) -> None:
        """Vertebral bodies with discs between them, which are a share of the slice, the arch and the canal."""
        vertebra = 1 - between
        self.add_disc(tissue, (0.0, 62.0), (24.0, 18.0), between * DISC + vertebra * CORTICAL)
        self.add_disc(tissue, (0.0, 62.0), (21.0, 15.0), between * DISC + vertebra * SPONGY)
        self.add_disc(tissue, (0.0, 96.0), (5.0, 14.0), CORTICAL, vertebra)
        self.add_disc(tissue, (0.0, 86.0), (15.0, 13.0), between * MUSCLE + vertebra * CORTICAL)
        self.add_disc(tissue, (0.0, 85.0), (10.0, 8.0), CANAL)

    def add_disc(
        self,
        tissue: NDArray[np.float64],
        middle: tuple[float, float],
        half: tuple[float, float],
        hu: float,
        share: float = 1.0,
    ) -> None:
        """Fill an ellipse, or a share of the slice in it."""
        left, right = np.searchsorted(self.x[0], (middle[0] - half[0], middle[0] + half[0]))
        top, bottom = np.searchsorted(self.y[:, 0], (middle[1] - half[1], middle[1] + half[1]))
        across = ((self.x[:, left:right] - middle[0]) / half[0]) ** 2
        along = ((self.y[top:bottom] - middle[1]) / half[1]) ** 2
        window = tissue[top:bottom, left:right]
        window += share * (across + along < 1.0) * (hu - window)


def _share_near_whole(low: NDArray[np.float64], high: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """Return which part of `low` to `high` is less than `distance`, at most 0.5, away from a whole number.

    Examples
    --------
    >>> _share_near_whole(np.array([0.0, 0.1]), np.array([3.0, 0.3]), 0.2).round(9).tolist()
    [0.4, 0.5]
    """
    below_low, below_high = (
        2 * distance * np.rint(end) + np.clip(end - np.rint(end), -distance, distance) for end in (low, high)
    )
    return (below_high - below_low) / (high - low)


def scanned(tissue: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.int16]:
    """Return the slice as a scanner shows it: blurred by about a pixel, with noise of about 14 HU.

    Tissue in whole HU, weights and noise are whole multiples of 2^-10 HU, so float32 holds every sum exactly.
    """
    image = blurred(np.rint(tissue).astype(np.float32))
    # Four bytes a pixel add up to nearly a normal deviate of mean 510 and standard deviation 148.
    dice = rng.integers(0, 2**32, image.shape, np.uint32)
    pairs = (dice & 0x00FF00FF) + ((dice >> 8) & 0x00FF00FF)
    sums = (pairs & 0xFFFF) + (pairs >> 16)
    image += (sums.astype(np.float32) - 510) * np.float32(0.25)
    return np.clip(np.rint(blurred(image)), -1024, 3071).astype(np.int16)


def blurred(image: NDArray[Any]) -> NDArray[np.float32]:
    """Return one pass of the weights 1/4, 1/2, 1/4 along rows and columns, the border repeated, float32."""
    out: NDArray[np.float32] = image
    for axis in range(2):
        padded = np.moveaxis(np.pad(out, [(1, 1) if at == axis else (0, 0) for at in range(2)], mode="edge"), axis, 0)
        total = padded[:-2] + padded[2:]
        total *= np.float32(0.5)
        total += padded[1:-1]
        total *= np.float32(0.5)
        out = np.moveaxis(total, 0, axis)
    return out
