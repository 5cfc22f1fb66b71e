# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `make demo`: reconstruct liver tumors of known volume in a CT as the paper does.

Su and Ma: labels of the tumors, a stride of 2 x 2 pixels, alpha, 90 % simplification; beside it strides of
1 and 3 pixels, and every volume against the phantom's truth. `make demo CT=PATH` does the same with a CT of your
own, its volumes against that with a stride of 1 pixel, and says what it chose. Everything lands in out/demo.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ctmc_addon import readers
from ctmc_addon.cli.flags.arguments import command_of
from ctmc_addon.cli.outputs import Outputs, written_steps
from ctmc_addon.cli.phantom.command import write_phantom_steps
from ctmc_addon.cli.phantom.files import WRITERS, require_own_slices
from ctmc_addon.cli.surfaces import Surfaces
from ctmc_addon.cli.terminal import Progress, dimensions, listing, table
from ctmc_addon.core import (
    CtmcError,
    LabelError,
    Reconstruction,
    ReconstructionSettings,
    Stage,
    Stages,
    Volume,
    equal_part,
    finish,
    reconstruct_steps,
)
from ctmc_addon.core.files.atomic_write import create_folder, write_json
from ctmc_addon.core.phantom.phantom import Phantom, phantom_steps
from ctmc_addon.core.segmentation import without_table_steps
from ctmc_addon.core.volume import ValueKind

FOLDER = Path(__file__).resolve().parents[1] / "out" / "demo"
SETTINGS = ReconstructionSettings(label=2, stride=(2, 2, 1), reduction=0.9)
SIDES = (1, 2, 3)
BONE_HU = 200.0
SMALLEST_MM3 = 500.0  # Smallest component of a threshold's surface.
STAGES = {"Making the phantom": 2, "Writing the phantom": 4, "Reading": 1, "Reconstructing": 6, "Writing": 7}


class Subject(NamedTuple):
    """The subject of a demo: what to reconstruct, and its true volume.

    Parameters
    ----------
    settings : ReconstructionSettings
    name : str
        Of the files.
    chosen : str
        Why these settings.
    made : Phantom, optional
        The truth.
    """

    settings: ReconstructionSettings
    name: str
    chosen: str
    phantom: Phantom | None = None

    @property
    def stride(self) -> int:
        """Return the pixels of the written surface."""
        return self.settings.stride[0]


def main() -> int:
    """Run the demo; 0 if all went well."""
    parser = argparse.ArgumentParser(description="Reconstruct a phantom, or a CT, the paper's way.")
    parser.add_argument("ct", nargs="?", type=Path, help="a CT or its labels, a file or folder (default: the phantom)")
    ct = parser.parse_args().ct
    try:
        demo(FOLDER) if ct is None else demo_of_ct(FOLDER, ct)
    except CtmcError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def demo(folder: Path, slices: int = 29, size: int = 512) -> None:
    """Make the phantom, reconstruct its tumors, write everything to `folder` and print the table."""
    create_folder(folder)
    require_own_slices(folder, list(WRITERS), slices)
    stages = Stages(STAGES)
    with Progress(lines=True) as progress:
        phantom = progress.finish(stages.run("Making the phantom", phantom_steps(slices, size)))
        progress.finish(stages.run("Writing the phantom", write_phantom_steps(phantom, folder, list(WRITERS))))
        chosen = (
            "the labels are smoothed with every sample on its own side, their volume kept; larger voxels cut corners"
        )
        subject = Subject(SETTINGS, "tumor", chosen, phantom)
        reconstructed(folder, folder / f"{phantom.labels.name}.nii.gz", stages, progress, subject)


def demo_of_ct(folder: Path, ct: Path) -> None:
    """Do the same with a CT: read it, choose what to reconstruct, write everything to `folder` and print the table."""
    create_folder(folder)
    with Progress(lines=True) as progress:
        reconstructed(folder, ct, Stages({name: STAGES[name] for name in list(STAGES)[2:]}), progress, None)


def chosen_subject(volume: Volume) -> Subject:
    """Return the subject in a volume: its largest label, bone if it has HU, else what Otsu's threshold divides."""
    if volume.kind == ValueKind.LABEL:
        labels, voxels = np.unique(volume.values[volume.values > 0], return_counts=True)
        if not labels.size:
            raise LabelError("the volume has no label; give a CT or labels")
        label = int(labels[voxels.argmax()])
        name = (volume.label_names or {}).get(label, f"label {label}")
        return Subject(
            replace(SETTINGS, label=label, close_border=True), "surface", f"{name}, the largest of {labels.size} labels"
        )
    settings = replace(SETTINGS, label=None, min_part_mm3=SMALLEST_MM3, close_border=True)
    small = f"without components below {SMALLEST_MM3:g} mm3"
    if volume.kind == ValueKind.HU and float(volume.values.max()) > BONE_HU:
        return Subject(
            replace(settings, threshold=BONE_HU),
            "surface",
            f"bone, {BONE_HU:g} HU and more, without the table, {small}",
        )
    return Subject(settings, "surface", f"what Otsu's threshold divides, {small}")


def reconstructed(folder: Path, path: Path, stages: Stages, progress: Progress, subject: Subject | None) -> None:
    """Read a volume, reconstruct it with all strides, write one surface and print the table."""
    volume = progress.finish(stages.run("Reading", readers.read_volume_steps(path)))
    if subject is None:
        subject = chosen_subject(volume)
        volume = finish(without_table_steps(volume)) if subject.settings.threshold is not None else volume
    results = {}
    for at, side in enumerate(SIDES):
        steps = reconstruct_steps(volume, replace(subject.settings, stride=(side, side, 1)))
        results[side] = progress.finish(stages.run("Reconstructing", equal_part(steps, at, len(SIDES))))
    paths = tuple(folder / f"{subject.name}{suffix}" for suffix in (".blend", ".stl"))
    outputs = Outputs(paths, figure=folder / f"{subject.name}.png")
    reading = Stage("Reading", stages.seconds["Reading"])
    result = replace(results[subject.stride], stages=(reading, *results[subject.stride].stages))
    surfaces, files = progress.finish(stages.run("Writing", written_steps(Surfaces(volume.name, (result,)), outputs)))
    (results[subject.stride],) = surfaces.results
    names = [file.name for file in files]
    write_json(folder / "report.json", report(subject, results, names))
    print(told(subject, volume, results, names, folder))


def true_mm3(subject: Subject, results: dict[int, Reconstruction]) -> float:
    """Return the reference volume: the truth, else that of the smallest voxels."""
    return sum(subject.phantom.tumour_volumes_mm3) if subject.phantom else results[SIDES[0]].mesh.volume


def against(true: float, volume_mm3: float) -> float:
    """Return the deviation of a volume from the true one, per cent."""
    return 100.0 * (volume_mm3 - true) / true


def report(subject: Subject, results: dict[int, Reconstruction], files: Sequence[str]) -> dict[str, Any]:
    """Return the report of the written run, the truth if known, and a row for every voxel side."""
    true = true_mm3(subject, results)
    truth = {}
    if subject.phantom:
        truth = {"true_volume_mm3": round(true, 3), "labelled_voxels_mm3": round(subject.phantom.counted_mm3(), 3)}
    rows = [
        {
            "stride": list(result.settings.stride),
            "seconds": sum(stage.seconds for stage in result.stages),
            "full_faces": result.full_faces,
            "faces": len(result.mesh.faces),
            "volume_mm3": result.mesh.volume,
            "volume_error_percent": against(true, result.mesh.volume),
            "closed": result.mesh.closed,
        }
        for result in results.values()
    ]
    return results[subject.stride].report() | {"files": list(files)} | truth | {"voxel_sides": rows}


def told(
    subject: Subject, volume: Volume, results: dict[int, Reconstruction], files: Sequence[str], folder: Path
) -> str:
    """Return the table of stages, seconds, triangles and volumes, a column for every voxel side."""
    names = [stage.name for stage in results[subject.stride].stages]
    seconds = [{stage.name: f"{stage.seconds:.3f}" for stage in result.stages} for result in results.values()]
    many, true, phantom = list(results.values()), true_mm3(subject, results), subject.phantom
    rows = [
        ("stride", *(f"{side} x {side} px" for side in results)),
        ("", *(f"{dimensions([round(side * volume.spacing[0], 2)])} mm" for side in results)),
        *((f"{name}, s", *(column.get(name, "-") for column in seconds)) for name in names),
        ("voxels visited", *(str(result.voxels_visited) for result in many)),
        ("triangles found", *(str(result.full_faces) for result in many)),
        ("triangles kept", *(str(len(result.mesh.faces)) for result in many)),
        ("volume, ml", *(f"{result.mesh.volume / 1000:.2f}" for result in many)),
        (
            "against the truth" if phantom else f"against {SIDES[0]} x {SIDES[0]} px",
            *(f"{against(true, result.mesh.volume):+.1f} %" for result in many),
        ),
        ("closed", *("yes" if result.mesh.closed else "no" for result in many)),
    ]
    shape = f"{dimensions(volume.size)} voxels of {dimensions(volume.spacing)} mm"
    facts = [("phantom", f"{shape}, {len(phantom.tumour_volumes_mm3)} tumors")] if phantom else [(volume.name, shape)]
    if phantom:
        counted = against(true, phantom.counted_mm3())
        facts.append(("truth", f"{true / 1000:.2f} ml of tumor; its labeled voxels count {counted:+.1f} %"))
    else:
        facts.append(("chosen", subject.chosen))
    facts.append(("settings", f"{command_of(subject.settings)} (strides 1 and 3 beside it)"))
    if phantom:
        facts.append(("", subject.chosen))
    end = [
        ("files", ", ".join([*files, "report.json", *(["the phantom"] if phantom else [])])),
        ("", f"in {folder.parent.name}/{folder.name}"),
    ]
    return f"\n{listing(facts)}\n\n{table(rows)}\n\n{listing(end)}"


if __name__ == "__main__":
    sys.exit(main())
