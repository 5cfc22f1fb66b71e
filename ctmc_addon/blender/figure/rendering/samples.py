# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the samples Cycles takes per pixel: a few with a denoiser, else as many as the noise needs.

The soft light of illustrations is what is noisy. The other styles are lit by suns, and have as many samples as smooth
outlines need; a denoiser would smear their triangle edges.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from ...colors import Color, srgb
from ..spec import FigureStyle

DENOISED = 32  # Most samples of a pixel before the denoiser; they decide how smooth edges are.
NOISE_DENOISED = 0.05  # The page and even surfaces, most of a picture, are below this noise after 16 samples.
FIRST_LOOK = 8  # Cycles tests noise at every 16th sample above this number; above 16 it would wait for the 32nd.
SMALL_PIXELS, DENOISED_SMALL = 40_000, 12  # A picture of fewer pixels is a thumbnail, and gets fewer samples.
NOISE = 0.02  # Noise of a pixel, as Cycles measures it, at which it stops without a denoiser.
FEWEST, MOST = 16, 512
COARSE_SAMPLES, FINE_SAMPLES, FINE_DPI = 32, 16, 250.0  # Visible pixels need more samples.
PATTERN = "TABULATED_SOBOL"  # Spreads few samples of a pixel evenly: edges of letters are smooth with 16.
LONGEST_S = 600.0  # Time limit for a picture or a tile of a large one; the remaining noise then stays.
OVERLAP = 24  # Rows that tiles share, because a denoiser looks at the surroundings of a pixel.
PAGE_LEVELS = 4  # Noise that a denoiser leaves on an empty page, of 255.
BORDER = 3  # Width in pixels of a page's empty border, where the denoiser leaves more noise.


def can_denoise() -> bool:
    """Return whether this Blender was built with Open Image Denoise; Debian's was not."""
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        return False
    return bool(_cycles.with_openimagedenoise)


def set_samples(scene: bpy.types.Scene, style: FigureStyle, dpi: float) -> None:
    """Set the samples of a style in Cycles; without a number, as many as a picture without noise needs."""
    cycles = scene.cycles
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.sampling_pattern = PATTERN
    if style.samples is not None or style.style != "illustration" or style.colors is not None:
        cycles.samples = style.samples or _samples_of_edges(dpi)
    elif can_denoise():
        small = scene.render.resolution_x * scene.render.resolution_y <= SMALL_PIXELS
        cycles.samples = DENOISED_SMALL if small else DENOISED
        cycles.use_adaptive_sampling = True
        cycles.adaptive_threshold, cycles.adaptive_min_samples = NOISE_DENOISED, FIRST_LOOK
        cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
        cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "FAST"
    else:
        cycles.samples, cycles.use_adaptive_sampling = MOST, True
        cycles.adaptive_threshold, cycles.adaptive_min_samples = NOISE, FEWEST
        cycles.time_limit = LONGEST_S


def _samples_of_edges(dpi: float) -> int:
    """Return the samples per pixel that make edges smooth."""
    return COARSE_SAMPLES if dpi < FINE_DPI else FINE_SAMPLES


@contextmanager
def without_noise(scene: bpy.types.Scene, dpi: float) -> Iterator[None]:
    """Set the samples that smooth edges need, for a part of the page without lit surfaces."""
    cycles = scene.cycles
    before = cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = _samples_of_edges(dpi), False, False
    try:
        yield
    finally:
        cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = before


def is_denoised(scene: bpy.types.Scene) -> bool:
    """Return whether a scene's pictures go through the denoiser."""
    return scene.render.engine == "CYCLES" and scene.cycles.use_denoising


def clean_page(rows: Any, paper: Color) -> Any:
    """Return rows of a picture, a Pillow image, whose page has one color again, as before the denoiser."""
    from PIL import Image

    levels = np.array(rows)
    page = np.array(srgb(paper), np.uint8)
    near = (np.abs(levels[..., :3].astype(np.int16) - page) <= PAGE_LEVELS).all(axis=2)
    levels[near, :3] = page
    return Image.fromarray(levels)


def clean_border(picture: Any, paper: Color) -> None:
    """Restore the page's color in the empty border of a picture, a Pillow image."""
    width, height = picture.size
    empty = srgb(paper) if picture.mode == "RGB" else (*srgb(paper), 0)
    for box in ((0, 0, width, BORDER), (0, height - BORDER, width, height),
                (0, 0, BORDER, height), (width - BORDER, 0, width, height)):  # fmt: skip
        picture.paste(empty, box)
