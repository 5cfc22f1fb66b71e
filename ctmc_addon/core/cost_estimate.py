"""What a surface will cost, before it is made: voxels, triangles, memory, seconds.

Voxels and triangles are counted by extraction's own first passes and are exact before simplification and before parts
are dropped. Seconds are those counts times what a unit of work costs in this process: measured once on a small ball,
and again on every surface that is made.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .errors import CtmcError, MemoryLimitError, MeshError
from .extraction.grid import Grid, make_grid
from .extraction.marching_cubes import Counts, count_steps, extract_steps
from .memory import available_bytes
from .pipeline import Reconstruction
from .progress import PAUSE, Step, Steps, timed_steps, within
from .settings import ReconstructionSettings
from .simplification.simplify import memory_needed, simplify_steps
from .volume.scalar_field import Field, field_steps
from .volume.thresholding import check_threshold
from .volume.volume import Volume

# Bytes: positions at both ends of alpha and normals are 36 a vertex, triangles 12; Blender keeps about as much again
# with keys, edges and corners; the built-in simplifier its edges, quadrics and costs.
VERTEX_BYTES, FACE_BYTES, ACTIVE_BYTES = 36, 12, 40
BLENDER_VERTEX_BYTES, BLENDER_FACE_BYTES = 60, 52
WIDEST = 16
BOUNDED_TIMES = 20  # what a largest distance costs a triangle, in removals: 10 on smooth surfaces, 35 on bone
BALL = 112  # samples along an axis of the ball that a fresh process is measured on


@dataclass(frozen=True)
class Price:
    """What the settings will cost.

    Parameters
    ----------
    voxels : int
        To visit.
    vertices, faces : int
        Exact, before simplification and before parts are dropped.
    memory : int
        Bytes at the highest.
    seconds : float
        Within a factor of two.
    scanned : float
        Seconds of the first passes among them.
    available : int or None
        Bytes there are.
    remedy : str
        Where it does not fit: what would.
    """

    voxels: int
    vertices: int
    faces: int
    memory: int
    seconds: float
    scanned: float = 0.0
    available: int | None = None
    remedy: str = ""

    @property
    def fits(self) -> bool:
        """Whether there is memory enough."""
        return self.available is None or self.memory <= self.available

    @property
    def sentence(self) -> str:
        """Why it cannot be started, and what could be; empty where it fits."""
        if self.fits or self.available is None:
            return ""
        return (
            f"this would need {self.memory / 2**30:.1f} GiB of memory and {self.available / 2**30:.1f} GiB are "
            f"available; {self.remedy}"
        )


@dataclass
class Calibration:
    """Seconds that a unit of work takes in this process."""

    vertex: float = 0.0
    face: float = 0.0
    removed: float = 0.0
    bounded: float = 0.0  # a triangle of a surface that is simplified to a largest distance
    placed: float = 2.0e-6  # a triangle measured and handed to Blender
    known: bool = False

    def measure_steps(self) -> Steps[None]:
        """Time a small ball, once in a process."""
        if self.known:
            return
        axis = np.arange(BALL, dtype=np.float32) - (BALL - 1) / 2
        square = axis * axis
        ball = -(square[:, None, None] + square[:, None] + square)
        yield PAUSE
        grid, level = make_grid(ball), -((BALL / 2.5) ** 2)
        yield from count_steps(grid, level, 1)  # the first run of new code is slower
        counts, scanned = yield from timed_steps(count_steps(grid, level))
        surface, seconds = yield from timed_steps(extract_steps(grid, level))
        self.vertex = self.face = max(1e-4, seconds - scanned) / (counts.vertices + counts.faces)
        _, seconds = yield from timed_steps(simplify_steps(surface.at(1.0), reduction=0.5))
        self.removed = seconds / (0.5 * counts.faces)
        self.bounded = BOUNDED_TIMES * self.removed
        self.known = True

    def learn(self, price: Price, result: Reconstruction, placed: float) -> None:
        """Take over what a real surface has cost; `placed` are the seconds after the last stage."""
        took = {stage.name: stage.seconds for stage in result.stages}
        removed = result.full_faces - len(result.mesh.faces)
        counted = price.faces + price.vertices
        if "Extracting the surface" in took and counted > 10_000:
            made = took["Extracting the surface"] + took.get("Placing it in the patient", 0.0) - price.scanned
            self.vertex = self.face = max(made, 0.0) / counted
        if "Simplifying" in took and removed > 1000:
            if result.settings.max_error_mm is not None:
                self.bounded = took["Simplifying"] / result.full_faces
            else:
                self.removed = took["Simplifying"] / removed
        if price.faces > 1000:
            self.placed = placed / price.faces


CALIBRATION = Calibration()


@dataclass
class Prepared:
    """The values to extract from, made again only when something that matters to them has changed."""

    volume: Volume
    threads: int | None = None
    memory_limit: int | None = None
    key: tuple[object, ...] | None = None
    field: Field | None = None
    seconds: float = 0.0

    def steps(self, settings: ReconstructionSettings) -> Steps[Field]:
        """The field for these settings."""
        key = (
            settings.label,
            settings.threshold is None,
            settings.soften_mm,
            settings.region,
            settings.region_unit,
            settings.nan_as,
            None if settings.label is None else settings.stride,
        )
        if self.field is None or key != self.key:
            work = field_steps(self.volume, settings, self.threads, self.memory_limit)
            self.field, self.seconds = yield from timed_steps(work)
            self.key = key
        elif settings.threshold is not None:
            self.field = replace(self.field, threshold=settings.threshold)
        return self.field


def price_steps(prepared: Prepared, settings: ReconstructionSettings) -> Steps[Price]:
    """What these settings will cost.

    Raises
    ------
    CtmcError
        Where they give no surface at all.
    """
    yield from within(CALIBRATION.measure_steps(), 0.0, 0.3)
    made = yield from within(prepared.steps(settings), 0.3, 0.6)
    counting = timed_steps(counted(made, settings, settings.stride, prepared.threads))
    counts, scanned = yield from within(counting, 0.6, 0.9)
    if not counts.faces:
        check_threshold(made.threshold, made.values, prepared.volume.kind)
        raise MeshError(f"no sample of this grid is cut off by threshold {made.threshold:g}; use a smaller stride")
    price = Price(
        voxels=grid_of(made, settings, settings.stride).voxels,
        vertices=counts.vertices,
        faces=counts.faces,
        memory=memory_of(counts, settings, made, prepared.volume),
        seconds=prepared.seconds + scanned + seconds_of(counts, settings),
        scanned=scanned,
        available=available_bytes() if prepared.memory_limit is None else prepared.memory_limit,
    )
    if not price.fits:
        price = replace(price, remedy=(yield from within(remedy_steps(prepared, made, settings, price), 0.9, 1.0)))
    yield Step(1.0, "Counted")
    return price


def grid_of(made: Field, settings: ReconstructionSettings, stride: tuple[int, int, int]) -> Grid:
    """The samples at a stride."""
    return make_grid(made.values, stride, settings.close_border, made.window_in_values)


def counted(
    made: Field, settings: ReconstructionSettings, stride: tuple[int, int, int], threads: int | None
) -> Steps[Counts]:
    """Extraction's own first passes."""
    return (yield from count_steps(grid_of(made, settings, stride), made.threshold, threads, settings.topology))


def goal_faces(faces: int, settings: ReconstructionSettings) -> int:
    """Triangles that the simplifier will leave, as far as that can be known."""
    if not settings.simplifies:
        return faces
    if settings.target_faces is not None:
        return min(faces, settings.target_faces)
    return round(faces * (1.0 - (0.9 if settings.reduction is None else settings.reduction)))


def seconds_of(counts: Counts, settings: ReconstructionSettings) -> float:
    """Seconds after the first passes."""
    work = CALIBRATION
    seconds = counts.vertices * work.vertex + counts.faces * (work.face + work.placed)
    if settings.simplifies and settings.simplifier == "builtin":
        if settings.max_error_mm is not None:
            seconds += counts.faces * work.bounded
        else:
            seconds += (counts.faces - goal_faces(counts.faces, settings)) * work.removed
    return seconds


def memory_of(counts: Counts, settings: ReconstructionSettings, made: Field, volume: Volume) -> int:
    """Bytes at the highest: the softened values, the surface, and the larger of simplifier and Blender's own."""
    softened = 0 if np.may_share_memory(made.values, volume.values) else made.values.nbytes
    surface = VERTEX_BYTES * counts.vertices + FACE_BYTES * counts.faces + ACTIVE_BYTES * counts.active
    builtin = settings.simplifies and settings.simplifier == "builtin"
    left = goal_faces(counts.faces, settings) if builtin else counts.faces
    blender = (BLENDER_FACE_BYTES + BLENDER_VERTEX_BYTES // 2) * left
    return softened + surface + max(memory_needed(counts.faces, settings.max_error_mm) if builtin else 0, blender)


def remedy_steps(prepared: Prepared, made: Field, settings: ReconstructionSettings, price: Price) -> Steps[str]:
    """The smallest wider stride that would fit, counted and not guessed."""
    x, y, z = settings.stride
    sizes = [stop - start for start, stop in made.window]
    while price.available is not None:
        if max(x, y) < WIDEST:
            x, y = min(x + 1, WIDEST), min(y + 1, WIDEST)
        elif z < WIDEST:
            z += 1
        else:
            break
        stride = tuple(min(one, size - 1) for one, size in zip((x, y, z), sizes, strict=True))
        try:
            counts = yield from counted(made, settings, (stride[0], stride[1], stride[2]), prepared.threads)
        except CtmcError:
            break
        if memory_of(counts, settings, made, prepared.volume) <= price.available:
            return f"voxel sides {stride[0]} {stride[1]} {stride[2]} would fit, or a smaller region"
    return "choose a smaller region"


def require_fits(price: Price) -> None:
    """Raise `MemoryLimitError` where there is not memory enough."""
    if not price.fits:
        raise MemoryLimitError(price.sentence)
