# SPDX-License-Identifier: GPL-3.0-or-later
"""How many samples Cycles takes of a pixel: some and a denoiser, or as many as the noise of the picture needs."""

from __future__ import annotations

import bpy

DENOISED = 48  # samples of a pixel before the denoiser; the smoothness of edges comes from them
NOISE = 0.012  # of a pixel, where there is no denoiser: Cycles measures it, and goes on until it is below
FEWEST, MOST = 24, 768
LONGEST_S = 1200.0  # of a picture or tile; what is left of the noise then stays


def can_denoise() -> bool:
    """Return whether this Blender was built with Open Image Denoise; Debian's was not."""
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        return False
    return bool(_cycles.with_openimagedenoise)


def set_samples(scene: bpy.types.Scene, samples: int | None = None) -> None:
    """Have Cycles take so many samples of each pixel, or as many as a picture without visible noise needs."""
    cycles = scene.cycles
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    if samples is not None:
        cycles.samples = samples
    elif can_denoise():
        cycles.samples = DENOISED
        cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
        cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "ACCURATE"
    else:
        cycles.samples, cycles.use_adaptive_sampling = MOST, True
        cycles.adaptive_threshold, cycles.adaptive_min_samples = NOISE, FEWEST
        cycles.time_limit = LONGEST_S
