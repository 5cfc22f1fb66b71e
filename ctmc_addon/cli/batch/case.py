# SPDX-License-Identifier: GPL-3.0-or-later
"""Make one case of a batch: read its volume once, and write every output with a JSON, also for errors."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ... import readers
from ...core import (
    GRAY_VALUES,
    HOLD,
    VERSION,
    AbsentLabelError,
    Budget,
    CtmcError,
    FinishedSurface,
    MadeSurface,
    ReconstructionSettings,
    Stage,
    SurfaceRequest,
    Volume,
    asked_bytes,
    combined,
    finish,
    make_surfaces_steps,
    measure,
    peak_bytes,
    resident_bytes,
)
from ...core.files.atomic_write import create_folder, write_json
from ...core.files.mesh_files import PAGE, SUFFIXES
from ...core.volume import (
    InsideValues,
    ValueKind,
    chosen_labels_steps,
    existing_labels_steps,
    inside_values_steps,
    label_extents_steps,
    region_box,
)
from ..commands.reconstruct import needed_steps, source_of
from ..flags.arguments import with_flags
from ..flags.solid import NOTHING, may_have_parts
from ..machine.blender_host import has_blender
from ..outputs import Outputs, written_steps
from ..surface_writer import SurfaceWriter
from ..surfaces import Surfaces, for_bed_steps, surface_of, surfaces_steps
from .files import (
    ABSENT,
    DONE,
    FAILED,
    batch_is_over,
    failed_record,
    identity,
    input_key,
    is_otsu,
    maps_of_task,
    options_of,
    put_output,
    record_path,
    require_batch,
    settings_of,
    since,
    size_of,
    solid_of_task,
    without_folders,
)

THUMBNAIL = (160, 120)
# Held while folders are made and outputs put in their places, so that the end of the batch leaves neither halfway.
CHANGING_FOLDERS = threading.Lock()
NO_HU = "mean_hu is empty: --hu takes labels of a CT volume-N with its segmentation-N beside it"
NO_HU_INSIDE = "mean_hu is empty: gray values are those of labels, which a solid changes"
NO_MEMORY = "there is not enough memory; choose a region, a larger stride or fewer jobs"

Ask = Callable[[int], None]


def do_case(task: Mapping[str, Any], unfinished: Path, ask: Ask | None = None) -> None:
    """Make every output of a case; each gets a JSON with its measures or its error."""
    case = CaseWork(task, unfinished, ask)
    for output in task["outputs"]:
        start = time.perf_counter()
        try:
            require_version(task)
            case.make(output, start)
        except AbsentLabelError as error:
            case.put_absent(output, with_flags(str(error)), since(start))
        except (CtmcError, MemoryError) as error:
            write_error(task, output, error, start)


def require_version(task: Mapping[str, Any]) -> None:
    """Raise an error where another version of ctmc takes a task than that of its batch."""
    if task["version"] != VERSION:
        raise CtmcError(f"ctmc here is {VERSION} and the batch's is {task['version']}; install the same")


def write_error(
    task: Mapping[str, Any],
    output: Mapping[str, Any],
    error: Exception,
    start: float,
    status: str = FAILED,
    key: Mapping[str, str] | None = None,
) -> None:
    """Write the JSON of an output that could not be made, unless the batch is over."""
    sentence = NO_MEMORY if isinstance(error, MemoryError) else with_flags(str(error))
    record = {**failed_record(task, output, sentence, since(start), status), **(key or {})}
    with CHANGING_FOLDERS:
        if not batch_is_over(task):
            write_json(record_path(Path(task["folder"]), output["name"]), record)


@dataclass(frozen=True)
class _AnnouncedBudget(Budget):
    """The budget of a case, which announces the memory of a task and waits until the batch has room for it.

    Parameters
    ----------
    announce : callable
        Takes the bytes that the work needs beside what the process has.
    """

    announce: Callable[[int], None] = lambda _: None

    def require(self, needed_bytes: int, what: str, remedy: str | Callable[[int], str]) -> None:
        """Announce the need; raise `MemoryLimitError` if it is more than is available then."""
        self.announce(needed_bytes)
        super().require(needed_bytes, what, remedy)


def announced_budget(task: Mapping[str, Any], ask: Ask) -> _AnnouncedBudget:
    """Return the budget of a task that has `reserved` bytes and asks for more.

    Labels that are made side by side, each in a thread of its own, need memory at once: the last need of each thread
    counts, beside what the process has, which may hold a part of that already.
    """
    lock, own = threading.Lock(), threading.get_ident()
    first = reserved = int(task["reserved"])
    last: dict[int, int] = {}

    def announce(needed_bytes: int) -> None:
        nonlocal reserved
        with lock:
            here = threading.get_ident()
            if here != own:  # which waits while others work
                last[here] = needed_bytes
                alive = {thread.ident for thread in threading.enumerate()}
                needed_bytes = sum(needed for thread, needed in last.items() if thread in alive)
            has = resident_bytes()
            total = asked_bytes(first if has is None else has, needed_bytes)
            if total > reserved:
                ask(total)
                reserved = total

    return _AnnouncedBudget(task["threads"], announce=announce)


class CaseWork:
    """The work on one case: its volume is read once for all outputs of the same file."""

    def __init__(self, task: Mapping[str, Any], unfinished: Path, ask: Ask | None = None) -> None:
        self.task = task
        self.budget = Budget(task["threads"]) if ask is None else announced_budget(task, ask)
        self.maps = maps_of_task(task)
        self.solid = solid_of_task(task)
        self.unfinished = unfinished
        self.source: Path | None = None
        self.volume: Volume | None = None
        self.input_key: dict[str, str] = {}
        self.outcomes: dict[int | None, MadeSurface | CtmcError] = {}
        self.ct: Volume | None = None

    def make(self, output: Mapping[str, Any], start: float) -> None:
        """Make one output, and put it in the place of an older one."""
        task, name = self.task, output["name"]
        settings = settings_of(output)
        volume = self.read(settings, bool(output["labels"]))
        choices, absent = _present_labels(volume, settings, output["labels"])
        reading = Stage("Reading", time.perf_counter() - start)
        thumbnail = self.unfinished / f"{name}.png" if task["thumbnails"] and _can_render() else None
        outputs = Outputs(
            figure=thumbnail,
            space=task["space"],
            thumbnail=THUMBNAIL,
            holds_all=bool(self.maps) or self.solid != NOTHING,
            shown_map=self.maps.shown,
            **self.output_fields(output),
        )
        written_bytes = outputs.triangle_bytes(settings.simplifier)
        with outputs.writer(settings.simplifier) as writer:
            if choices or self.solid:
                maps, solid = self.maps, self.solid
                making = surfaces_steps(
                    volume, settings, choices, self.budget, writer, written_bytes, maps=maps, solid=solid
                )
                surfaces = finish(making)
            else:
                surfaces = self.surface(volume, settings, output["beside"], writer, written_bytes)
                surfaces = finish(for_bed_steps(surfaces, self.solid, self.budget))
            surfaces, _ = finish(written_steps(surfaces, outputs))
        files = outputs.surface_files(surfaces) + ([outputs.map_table] if outputs.map_table else [])
        names = [file.relative_to(self.unfinished).as_posix() for file in files]
        if len(output["labels"]) > 1 and not surfaces.are_several:  # the one that the case has: a row of labels.csv too
            surfaces = replace(surfaces, names=surfaces.titles)
        report = _report_of(surfaces)
        notes = [with_flags(without_folders(note, task)) for note in report["notes"]]
        hu = self.hu_inside(surfaces, volume) if task.get("hu") and not self.solid else []
        if hu is None or (task.get("hu") and self.solid):
            notes.append(NO_HU_INSIDE if self.solid else NO_HU)
        for each, inside in zip(report.get("surfaces", [report]), hu or []):  # noqa: B905  (there may be none)
            each.update(inside)
        record = {
            "case": name,
            "status": DONE,
            "error": None,
            **report,
            "stages": [reading._asdict(), *report["stages"]],
            "notes": notes,
            **identity(task, output),
            **self.input_key,
            "run": task["run"],
            **({"absent_labels": absent} if absent else {}),
            **({"labels_as_one": True} if volume.kind == ValueKind.LABEL and is_otsu(settings) and not choices else {}),
            "seconds": since(start),
            "memory_bytes": peak_bytes(),
            "files": names,
            "file_bytes": {name: size_of(file) for name, file in zip(names, files, strict=True)},
        }
        self.put(name, files, thumbnail, record)

    def put(self, name: str, files: Sequence[Path], thumbnail: Path | None, record: Mapping[str, Any]) -> None:
        """Move complete files to the batch's folder, unless the batch is over and another one may own the folder."""
        with CHANGING_FOLDERS:
            if not batch_is_over(self.task):
                put_output(Path(self.task["folder"]), name, self.unfinished, files, thumbnail, record)

    def surface(
        self,
        volume: Volume,
        settings: ReconstructionSettings,
        shared_labels: Sequence[int],
        writer: SurfaceWriter | None,
        written_bytes: int,
    ) -> Surfaces:
        """Return the surface of an output; the first call makes those of all `shared_labels` and keeps them."""
        label = settings.label
        if label not in self.outcomes:
            every = [replace(settings, label=each_label) for each_label in shared_labels] or [settings]
            own = HOLD if writer is None else writer.sink_of(label)
            sinks = [own if each.label == label else HOLD for each in every]
            requests = [
                SurfaceRequest(each, sink, written_bytes=written_bytes) for each, sink in zip(every, sinks, strict=True)
            ]
            maps = finish(self.maps.request_steps(volume, self.budget)) if self.maps else None
            outcomes = finish(make_surfaces_steps(volume, requests, self.budget, maps=maps))
            self.outcomes = dict(zip((each.label for each in every), outcomes, strict=True))
        else:
            writer = None  # it was held
        outcome = self.outcomes.pop(label)
        if isinstance(outcome, CtmcError):
            raise outcome
        return surface_of(volume, outcome, writer)

    def hu_inside(self, surfaces: Surfaces, labels: Volume) -> list[dict[str, float]] | None:
        """Return mean and deviation of the CT inside the label of each surface; None without a CT beside the labels."""
        path = Path(self.task["input"])
        if self.source == path:
            return None
        if self.ct is None:
            options = options_of(self.task)
            opened = finish(readers.open_volume_steps(path, options.allow_outside))
            self.ct = finish(needed_steps(opened, path, options, ReconstructionSettings(), True, budget=self.budget))
        each = [self.inside(self.ct, labels, result.settings) for result in surfaces.results]
        return [
            {}
            if values is None
            else {about.name: round(about.value(FinishedSurface(inside=values)), 3) for about in GRAY_VALUES}
            for values in each
        ]

    def inside(self, ct: Volume, labels: Volume, settings: ReconstructionSettings) -> InsideValues | None:
        """Return the values of the CT inside the label of a surface."""
        assert settings.label is not None, "labels lie beside the CT"
        return finish(inside_values_steps(ct, labels, settings.label, region_box(labels, settings)))

    def put_absent(self, output: Mapping[str, Any], sentence: str, seconds: float) -> None:
        """Record that the case lacks the label of an output, and remove the files of an older run."""
        record = failed_record(self.task, output, sentence, seconds, ABSENT) | self.input_key
        self.put(output["name"], [], None, record)

    def output_fields(self, output: Mapping[str, Any]) -> dict[str, Any]:
        """Return the paths of surfaces until they are complete; several go to a folder if one file cannot hold them."""
        name, suffix = output["name"], self.task["format"]
        with CHANGING_FOLDERS:
            require_batch(self.task)  # or its hidden folder would come again
            own = create_folder(self.unfinished)
            pages = (own / f"{name}{PAGE}",) if self.task.get("html") and suffix != PAGE else ()
            table = {"map_table": own / f"{name}-maps.csv"} if self.task.get("map_table") and self.maps else {}
            if (output["labels"] or may_have_parts(self.solid)) and suffix in SUFFIXES:
                return {"folder": create_folder(own / name), "suffix": suffix, "surfaces": pages, **table}
        return {"surfaces": (own / f"{name}{suffix}", *pages), **table}

    def read(self, settings: ReconstructionSettings, several: bool) -> Volume:
        """Return the volume that the label is in, kept for the outputs to come."""
        path = Path(self.task["input"])
        source = source_of(path, settings.label)
        if self.volume is None or self.source != source:
            self.volume = None
            options = options_of(self.task)
            opened = finish(readers.open_volume_steps(source, options.allow_outside))
            self.input_key = input_key(opened, self.task["verify"])
            volume = finish(needed_steps(opened, path, options, settings, several, budget=self.budget))
            self.volume = replace(volume, name=self.task["case"])  # which a manifest may have given
            self.source = source
        return self.volume


def _present_labels(
    volume: Volume, settings: ReconstructionSettings, choices: Sequence[int | str]
) -> tuple[list[int | str], list[int | str]]:
    """Return which of several labels the volume has, and which are absent: a table may name what no voxel has.

    Raises
    ------
    AbsentLabelError
        If it has none of them.
    """
    box = region_box(volume, settings)
    present: list[int | str] = []
    absent: list[int | str] = []
    refusal: AbsentLabelError | None = None
    for choice in choices:
        try:
            values = finish(chosen_labels_steps(volume, [choice], box))
            if finish(label_extents_steps(volume, box)).keys().isdisjoint(values):
                raise AbsentLabelError(f"no voxel has the label {choice}; {finish(existing_labels_steps(volume, box))}")
            present.append(choice)
        except AbsentLabelError as error:
            refusal = error
            absent.append(choice)
    if refusal is not None and not present:
        raise refusal
    return present, absent


def _report_of(surfaces: Surfaces) -> dict[str, Any]:
    """Return the report of surfaces for a JSON; of several with the sum of their triangles."""
    report = surfaces.report()
    if not surfaces.are_several:
        return report
    finished = [result.finished for result in surfaces.results]

    def of_all(name: str) -> Any:
        return combined(measure(name), list(map(measure(name).value, finished)))

    # Self-intersections are of each surface, not between them.
    of_several = {"faces": of_all("faces"), "volume_mm3": None, "self_intersections": of_all("self_intersections")}
    return report | of_several | {"stages": []}


def _can_render() -> bool:
    """Return whether there is a Blender with the engine for thumbnails; without it there are none."""
    if not has_blender():
        return False
    import bpy

    return hasattr(bpy.types.Scene, "cycles")
