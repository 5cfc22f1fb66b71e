# SPDX-License-Identifier: GPL-3.0-or-later
"""What a surface will cost, before it is made: voxels, triangles, memory, seconds.

Voxels and triangles are counted by extraction's own first passes and are exact before simplification and before
components are dropped. Seconds are those counts times what a unit of work takes in this process: measured once on a
small ball, and again on every surface that is made.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .errors import CtmcError, MemoryLimitError, MeshError
from .extraction.grid import Grid, make_grid
from .extraction.marching_cubes import Counts, count_steps, extract_steps
from .fitting import SLABS_BYTES, Fitting, proposals_steps
from .memory import available_bytes
from .pipeline import STREAMED_NOTE
from .progress import PAUSE, Stages, Steps, timed_steps
from .reconstruction import Reconstruction
from .settings import ReconstructionSettings
from .simplification.simplify import simplify_steps
from .streaming import counted_steps
from .volume.scalar_field import ScalarField, scalar_field_steps
from .volume.thresholding import check_threshold
from .volume.volume import Volume

MOST_STRIDE = 16
BOUNDED_COLLAPSES = 20  # collapses that a triangle costs with a maximum error: 10 on smooth surfaces, 35 on bone
BALL_SAMPLES = 112  # along an axis of the ball that a fresh process is measured on


@dataclass(frozen=True)
class CostEstimate:
    """What a surface with some settings will cost.

    Parameters
    ----------
    voxels : int
        To visit.
    vertices, faces : int
        Exact, before simplification and before components are dropped.
    memory : int
        Peak, bytes.
    seconds : float
        Within a factor of two.
    counting_seconds : float
        Of the first passes, among the seconds.
    available : int or None
        Bytes of memory that can be had.
    remedy : str
        Where it does not fit: what would.
    """

    voxels: int
    vertices: int
    faces: int
    memory: int
    seconds: float
    counting_seconds: float = 0.0
    available: int | None = None
    remedy: str = ""

    @property
    def fits(self) -> bool:
        """Whether there is enough memory."""
        return self.available is None or self.memory <= self.available

    @property
    def sentence(self) -> str:
        """Why the surface cannot be made, and what would fit; empty where it fits."""
        if self.fits or self.available is None:
            return ""
        return (
            f"this would need {self.memory / 2**30:.1f} GiB of memory and {self.available / 2**30:.1f} GiB are "
            f"available; {self.remedy}"
        )


@dataclass
class Calibration:
    """Seconds that a unit of work takes in this process.

    Parameters
    ----------
    vertex, face : float
        To extract one.
    collapse : float
        To remove a triangle.
    bounded_face : float
        To simplify a triangle with a maximum error.
    blender_face : float
        To measure a triangle and hand it to Blender.
    measured : bool
    """

    vertex: float = 0.0
    face: float = 0.0
    collapse: float = 0.0
    bounded_face: float = 0.0
    blender_face: float = 2.0e-6
    measured: bool = False

    def measure_steps(self) -> Steps[None]:
        """Time a small ball, once in a process."""
        if self.measured:
            return
        axis = np.arange(BALL_SAMPLES, dtype=np.float32) - (BALL_SAMPLES - 1) / 2
        square = axis * axis
        ball = -(square[:, None, None] + square[:, None] + square)
        yield PAUSE
        grid, threshold = make_grid(ball), -((BALL_SAMPLES / 2.5) ** 2)
        yield from count_steps(grid, threshold, 1)  # the first run of new code is slower
        counts, counting = yield from timed_steps(count_steps(grid, threshold))
        surface, seconds = yield from timed_steps(extract_steps(grid, threshold))
        self.vertex = self.face = max(1e-4, seconds - counting) / (counts.vertices + counts.faces)
        _, seconds = yield from timed_steps(simplify_steps(surface.at(1.0), reduction=0.5))
        self.collapse = seconds / (0.5 * counts.faces)
        self.bounded_face = BOUNDED_COLLAPSES * self.collapse
        self.measured = True

    def learn(self, estimate: CostEstimate, result: Reconstruction, blender_seconds: float) -> None:
        """Take over the seconds of a real surface; `blender_seconds` are those after its last stage."""
        if STREAMED_NOTE in result.notes:
            return  # its stages ran into each other
        seconds = {stage.name: stage.seconds for stage in result.stages}
        removed = result.full_faces - len(result.mesh.faces)
        counted = estimate.faces + estimate.vertices
        if "Extracting the surface" in seconds and counted > 10_000:
            extracting = seconds["Extracting the surface"] + seconds.get("Placing it in the patient", 0.0)
            self.vertex = self.face = max(extracting - estimate.counting_seconds, 0.0) / counted
        if "Simplifying" in seconds and removed > 1000:
            if result.settings.max_error_mm is not None:
                self.bounded_face = seconds["Simplifying"] / result.full_faces
            else:
                self.collapse = seconds["Simplifying"] / removed
        if estimate.faces > 1000:
            self.blender_face = blender_seconds / estimate.faces


CALIBRATION = Calibration()


@dataclass
class FieldCache:
    """The scalar field of a volume, made again only when a setting that matters to it has changed."""

    volume: Volume
    threads: int | None = None
    memory_limit: int | None = None
    key: tuple[object, ...] | None = None
    field: ScalarField | None = None
    seconds: float = 0.0

    @property
    def available(self) -> int | None:
        """Bytes of memory that can be had."""
        return available_bytes() if self.memory_limit is None else self.memory_limit

    def field_steps(self, settings: ReconstructionSettings) -> Steps[ScalarField]:
        """Return the scalar field for these settings."""
        key = (
            settings.label,
            settings.threshold is None,
            settings.smoothing_method,
            settings.gaussian_mm,
            settings.slice_steps,
            settings.close_border and settings.smoothing_method == "constrained",
            settings.region,
            settings.region_unit,
            settings.nan_as,
            None if settings.label is None else settings.stride,
        )
        if self.field is None or key != self.key:
            work = scalar_field_steps(self.volume, settings, self.threads, self.memory_limit)
            self.field, self.seconds = yield from timed_steps(work)
            self.key = key
        elif settings.threshold is not None:
            self.field = replace(self.field, threshold=settings.threshold, level=settings.threshold)
        return self.field


def cost_estimate_steps(cache: FieldCache, settings: ReconstructionSettings) -> Steps[CostEstimate]:
    """Return what a surface with these settings will cost.

    Raises
    ------
    CtmcError
        Where they give no surface at all.
    """
    stages = Stages({"Measuring the machine": 3, "Preparing values": 3, "Counting": 3, "Looking for what fits": 1})
    yield from stages.run("Measuring the machine", CALIBRATION.measure_steps())
    try:
        field = yield from stages.run("Preparing values", cache.field_steps(settings))
    except MemoryLimitError:
        if settings.smoothing_method == "constrained":
            raise
        return (yield from stages.run("Counting", _slab_by_slab_steps(cache, settings)))
    grid = grid_of(field, settings, settings.stride)
    counting = count_steps(grid, field.level, cache.threads, settings.topology)
    counts = yield from stages.run("Counting", counting)
    if not counts.faces:
        check_threshold(field.level, grid.window_values, field.kind, field.place, grid.upper)
        raise MeshError(f"there is no surface: threshold {field.threshold:g} separates no samples of this stride")
    seconds = stages.seconds["Counting"]
    available = cache.available
    estimate = CostEstimate(
        voxels=grid.voxels,
        vertices=counts.vertices,
        faces=counts.faces,
        memory=memory_of(counts.faces, settings, field, cache.volume, available),
        seconds=cache.seconds + seconds + seconds_after_counting(counts, settings),
        counting_seconds=seconds,
        available=available,
    )
    if not estimate.fits:
        looking = remedy_steps(cache, field, settings, estimate)
        estimate = replace(estimate, remedy=(yield from stages.run("Looking for what fits", looking)))
    return estimate


def _slab_by_slab_steps(cache: FieldCache, settings: ReconstructionSettings) -> Steps[CostEstimate]:
    """The cost where the values are smoothed a slab at a time, as they do not fit at once."""
    volume, threads, available = cache.volume, cache.threads, cache.available
    stages = Stages({"Counting": 9, "Looking for what fits": 1})
    counts = yield from stages.run("Counting", counted_steps(volume, settings, threads, cache.memory_limit))
    if not counts.faces:
        raise MeshError("there is no surface with these settings; choose another threshold or a smaller stride")
    fitting, seconds = Fitting(counts.faces, settings), stages.seconds["Counting"]
    held = SLABS_BYTES + fitting.held
    estimate = CostEstimate(
        voxels=counts.voxels,
        vertices=counts.vertices,
        faces=counts.faces,
        memory=held if available is None or held <= available else fitting.needed,
        seconds=seconds + seconds_after_counting(counts, settings),
        counting_seconds=seconds,
        available=available,
    )
    if estimate.fits or available is None:
        return estimate
    looking = proposals_steps(volume, fitting, available, threads)
    proposals = yield from stages.run("Looking for what fits", looking)
    return replace(estimate, remedy=f"{' or '.join(proposals)} would fit" if proposals else "choose a smaller region")


def grid_of(field: ScalarField, settings: ReconstructionSettings, stride: tuple[int, int, int]) -> Grid:
    """Return the samples of a field at a stride."""
    return make_grid(field.values, stride, settings.close_border, field.window_in_values, settings.upper)


def seconds_after_counting(counts: Counts, settings: ReconstructionSettings) -> float:
    """Return the seconds of all that follows the first passes."""
    work = CALIBRATION
    seconds = counts.vertices * work.vertex + counts.faces * (work.face + work.blender_face)
    fitting = Fitting(counts.faces, settings)
    if fitting.simplifies and settings.max_error_mm is not None:
        seconds += counts.faces * work.bounded_face
    else:
        seconds += (counts.faces - fitting.left) * work.collapse
    return seconds


def memory_of(
    faces: int, settings: ReconstructionSettings, field: ScalarField, volume: Volume, available: int | None
) -> int:
    """Return the peak, bytes: of smoothing, or of its values and the surface; simplified as extracted if it must be."""
    smoothed = 0 if np.may_share_memory(field.values, volume.values) else field.values.nbytes
    fitting = Fitting(faces, settings)
    needed = max(field.working_bytes, smoothed + fitting.held)
    if available is not None and needed > available and fitting.simplifies:
        needed = max(field.working_bytes, smoothed + fitting.streamed)
    return needed


def remedy_steps(
    cache: FieldCache, field: ScalarField, settings: ReconstructionSettings, estimate: CostEstimate
) -> Steps[str]:
    """Return the smallest wider stride that would fit, counted and not guessed."""
    x, y, z = settings.stride
    sizes = [stop - start for start, stop in field.window]
    while estimate.available is not None:
        if max(x, y) < MOST_STRIDE:
            x, y = min(x + 1, MOST_STRIDE), min(y + 1, MOST_STRIDE)
        elif z < MOST_STRIDE:
            z += 1
        else:
            break
        wider = (min(x, sizes[0] - 1), min(y, sizes[1] - 1), min(z, sizes[2] - 1))
        grid = grid_of(field, settings, wider)
        try:
            counts = yield from count_steps(grid, field.level, cache.threads, settings.topology)
        except CtmcError:
            break
        needed = memory_of(counts.faces, settings, field, cache.volume, estimate.available)
        if needed <= estimate.available:
            return f"stride {wider[0]} {wider[1]} {wider[2]} would fit, or a smaller region"
    return "choose a smaller region"
