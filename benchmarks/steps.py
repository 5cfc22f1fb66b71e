# SPDX-License-Identifier: GPL-3.0-or-later
"""How long the panel's jobs go between two steps, which is how long Esc and the window may have to wait for them.

A phantom of 512 x 512 x 250 as DICOM and as NIfTI goes through the very generators that the panel's buttons drive, and
every gap is timed: from the press to the first step, between two steps, the job's conclusion, which writes to the
scene, and Esc, where a job is left after a while. A gap has the name that the status bar shows meanwhile.
Run as `PYTHONPATH=tests .venv/bin/python -m benchmarks.steps`.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

import ctmc_addon
from ctmc_addon.blender.export import export
from ctmc_addon.cli.phantom.files import write_dicom_steps, write_nifti_steps
from ctmc_addon.core import FieldCache, ReconstructionSettings
from ctmc_addon.core.maps import QUANTITIES, Quantity
from ctmc_addon.core.progress import Steps, finish
from ctmc_addon.readers import ReadingOptions
from ctmc_addon.ui.operators.ct import load
from ctmc_addon.ui.operators.results import maps, results
from ctmc_addon.ui.operators.surface import reconstruct
from ctmc_addon.ui.operators.surface.placing import ObjectRequest
from ctmc_addon.ui.properties.preferences import machine
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.state.results import measurements, surfaces
from ctmc_addon.ui.viewport.surface import live, preview

from . import scenes

PRESS, CONCLUSION, ESC = "(the press)", "(conclusion)", "(Esc)"
CLASSIC = ReconstructionSettings(threshold=scenes.DENSE_THRESHOLD)
FILES = ("stl", "ply", "obj", "glb")


@dataclass
class Gap:
    """The longest time one stage goes between two steps, and the whole of it, in seconds."""

    steps: int = 0
    longest: float = 0.0
    processor: float = 0.0  # Processor seconds of the longest gap, over all threads.
    whole: float = 0.0


def gaps(begin: Callable[[], Steps[Any]], most: float) -> dict[str, Gap]:
    """Run a job to its end with its conclusion, or leave it after `most` seconds; return the gaps by stage."""
    gaps_by_stage: dict[str, Gap] = {}
    started = wall = time.perf_counter()
    processor = time.process_time()

    def note(name: str) -> None:
        nonlocal wall, processor
        now, used = time.perf_counter(), time.process_time()
        gap = gaps_by_stage.setdefault(name, Gap())
        gap.steps += 1
        gap.whole += now - wall
        if now - wall > gap.longest:
            gap.longest, gap.processor = now - wall, used - processor
        wall, processor = time.perf_counter(), time.process_time()

    steps, name = begin(), PRESS
    while wall - started < most:
        try:
            step = next(steps)
        except StopIteration as end:
            note(name)
            if callable(end.value):
                end.value()
                note(CONCLUSION)
            return gaps_by_stage
        note(name)
        name = step.message
    steps.close()
    note(ESC)
    return gaps_by_stage


def at_once(call: Callable[[], Any]) -> Steps[None]:
    """Return work without steps as a job of one step."""
    call()
    return
    yield


def least(runs: list[dict[str, Gap]]) -> dict[str, Gap]:
    """Return for every stage the run with the shortest longest gap: other load on the machine only adds time."""
    return {
        name: min((run[name] for run in runs if name in run), key=lambda gap: gap.longest)
        for name in dict.fromkeys(name for run in runs for name in run)
    }


class Panel:
    """A scene with the phantom, and its buttons."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.scene = folder, bpy.context.scene
        phantom = scenes.abdomen_phantom()
        for write in (write_dicom_steps, write_nifti_steps):
            finish(write(phantom, folder))
        self.ct, self.labels = folder / f"{phantom.volume.name}.nii.gz", folder / f"{phantom.labels.name}.nii.gz"

    def load(self, path: Path) -> Steps[Any]:
        """Load CT."""
        return load.CTMC_OT_load.steps(None, path, ReadingOptions(), self.scene.session_uid, "", 1, ())

    def reconstruct(self, settings: ReconstructionSettings, target: Any = None) -> Steps[Any]:
        """Run Reconstruct Surface, or Update Surface of an object."""
        uid = None if target is None else target.session_uid
        request = ObjectRequest(settings, target=uid, fingerprint=self.scene.ctmc.volume_fingerprint)
        return reconstruct.surfaces_steps(volumes.current(self.scene), [request], self.scene.session_uid)

    @property
    def surface(self) -> Any:
        """Return the surface made last."""
        return bpy.context.view_layer.objects.active

    def simplify(self, **goal: Any) -> Steps[Any]:
        """Run Simplify Surface."""
        request = ObjectRequest(
            replace(CLASSIC, simplifier="builtin", **goal),
            target=self.surface.session_uid,
            fingerprint=self.scene.ctmc.volume_fingerprint,
        )
        return reconstruct.surfaces_steps(None, [request], self.scene.session_uid, self.full)

    @property
    def full(self) -> Any:
        """Return the surface made last, before simplification."""
        return surfaces.full_of(self.surface, self.scene)

    def add_map(self, kind: type[Quantity]) -> Steps[Any]:
        """Run Add Map."""
        return maps.added_steps(self.surface, self.scene, kind, "", {})

    def move_slider(self) -> None:
        """Run the coarse preview of a moving slider."""
        self.scene.ctmc.threshold = self.scene.ctmc.threshold + 7
        live.tick()

    def rest(self) -> Steps[None]:
        """Run what follows when nothing changes: the cost estimate, then a finer preview."""
        live.live.stop_work()
        uid, settings = self.scene.session_uid, self.scene.ctmc.to_settings()
        volume = volumes.current(self.scene)
        preview.prepare(volume)
        yield from live.cost_steps(uid, [(FieldCache(volume, machine().budget), settings)])
        yield from preview.refine_steps(uid, settings)

    def jobs(self) -> Iterator[tuple[str, Callable[[], Steps[Any]]]]:
        """Return all measured jobs, in an order in which each has what it needs."""
        yield "Load CT, NIfTI", lambda: self.load(self.ct)
        yield "Load CT, DICOM folder", lambda: self.load(self.folder / "dicom")
        self.scene.ctmc.threshold = 200.0
        yield "Move a slider, preview", lambda: at_once(self.move_slider)
        yield "Idle: cost and finer preview", self.rest
        yield "Reconstruct, bone", lambda: self.reconstruct(replace(CLASSIC, threshold=200.0))
        yield "Reconstruct, softened 1 mm", lambda: self.reconstruct(replace(CLASSIC, smoothing_mm=1.0))
        yield "Reconstruct, largest part", lambda: self.reconstruct(replace(CLASSIC, keep_parts=1))
        yield "Reconstruct, mesh normals", lambda: self.reconstruct(replace(CLASSIC, normals="mesh"))
        yield "Reconstruct, trilinear", lambda: self.reconstruct(replace(CLASSIC, topology="trilinear"))
        yield "Reconstruct, classic", lambda: self.reconstruct(CLASSIC)
        yield "Update, classic", lambda: self.reconstruct(CLASSIC, self.surface)
        for suffix in FILES:
            path = self.folder / f"surface.{suffix}"
            yield f"Export {suffix.upper()}", lambda path=path: at_once(lambda: export(self.surface, path))
        yield "Measure", self.measure
        yield "Simplify by 50 %", lambda: self.simplify(reduction=0.5)
        yield "Simplify to 100,000", lambda: self.simplify(target_faces=100_000)
        yield "Simplify within 0.5 mm", lambda: self.simplify(max_error_mm=0.5)
        for kind in QUANTITIES:
            if not kind.metavar:
                yield f"Map: {kind.label}", lambda kind=kind: self.add_map(kind)
        yield "Load its labels", lambda: self.load(self.labels)
        yield "Reconstruct, label softened", lambda: self.reconstruct(ReconstructionSettings(label=1, smoothing_mm=1.0))

    def measure(self) -> Steps[Any]:
        """Measure."""
        mesh = results.as_shown(self.surface, self.scene).mesh
        return results.measure_steps(mesh, self.full, self.surface.session_uid, measurements.mesh_state(self.surface))


def clear(panel: Panel) -> None:
    """Take the surfaces of earlier runs away, but the last."""
    for obj in [obj for obj in panel.scene.objects if obj.type == "MESH" and obj != panel.surface]:
        bpy.data.meshes.remove(obj.data)


def main() -> int:
    """Print a line for every stage, the longest gap first in its job."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.steps", description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3, help="runs of a job; that with the shortest gap counts")
    parser.add_argument("--only", default="", help="show the jobs whose name has these letters; others run once")
    parser.add_argument("--most", type=float, default=30.0, help="leave a job after so long [s], as Esc does")
    parser.add_argument("--least", type=float, default=0.05, help="leave out stages whose longest gap is below [s]")
    options = parser.parse_args()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    ctmc_addon.register()
    load_average = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    print(f"# Blender {bpy.app.version_string}, {os.cpu_count()} processors, load {load_average}")
    print(f"{'job':30}  {'stage':46}  {'steps':>6}  {'longest_s':>9}  {'its_cpu_s':>9}  {'whole_s':>8}")
    with tempfile.TemporaryDirectory(prefix="ctmc-steps-") as scratch:
        panel = Panel(Path(scratch))
        for job, begin in panel.jobs():
            chosen = options.only.lower() in job.lower()
            longest_gaps = least([gaps(begin, options.most) for _ in range(options.repeats if chosen else 1)])
            clear(panel)
            if not chosen:
                continue
            for stage, gap in sorted(longest_gaps.items(), key=lambda item: -item[1].longest):
                if gap.longest >= options.least or gap == max(longest_gaps.values(), key=lambda one: one.longest):
                    print(
                        f"{job:30}  {stage:46}  {gap.steps:6}  {gap.longest:9.3f}  {gap.processor:9.3f}  "
                        f"{gap.whole:8.2f}",
                        flush=True,
                    )
    sys.stdout.flush()
    os._exit(0)  # Blender as a module may hang while Python shuts down


if __name__ == "__main__":
    sys.exit(main())
