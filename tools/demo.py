# SPDX-License-Identifier: GPL-3.0-or-later
"""What `make demo` runs: a CT with liver tumours of known volume, and their surface the paper's way.

Su and Ma: labels of the tumours, a stride of 2 x 2 pixels, alpha, 90 % simplification; beside it strides of
1 and 3 pixels, and every volume against the phantom's truth. Everything lands in out/demo.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from ctmc_addon import readers
from ctmc_addon.cli.arguments import command_of
from ctmc_addon.cli.outputs import Outputs, written_steps
from ctmc_addon.cli.phantom.command import write_phantom_steps
from ctmc_addon.cli.phantom.files import WRITERS, require_own_slices
from ctmc_addon.cli.surfaces import Surfaces
from ctmc_addon.cli.terminal import Progress, dimensions, listing, table
from ctmc_addon.core import (
    CtmcError,
    Reconstruction,
    ReconstructionSettings,
    Stage,
    Stages,
    Volume,
    equal_part,
    reconstruct_steps,
)
from ctmc_addon.core.files.atomic_write import made_folder, write_json
from ctmc_addon.core.phantom.phantom import Phantom, phantom_steps

FOLDER = Path(__file__).resolve().parents[1] / "out" / "demo"
SETTINGS = ReconstructionSettings(label=2, stride=(2, 2, 1), reduction=0.9)
SIDES = (1, 2, 3)
STAGES = {"Making the phantom": 2, "Writing the phantom": 4, "Reading": 1, "Reconstructing": 6, "Writing": 7}


def main() -> int:
    """Run the demo; 0 if all went well."""
    try:
        demo(FOLDER)
    except CtmcError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def demo(folder: Path, slices: int = 29, size: int = 512) -> None:
    """Make the phantom, reconstruct its tumours, write everything to `folder` and print the table."""
    made_folder(folder)
    require_own_slices(folder, list(WRITERS), slices)
    stages = Stages(STAGES)
    with Progress(lines=True) as progress:
        made = progress.finish(stages.run("Making the phantom", phantom_steps(slices, size)))
        progress.finish(stages.run("Writing the phantom", write_phantom_steps(made, folder, list(WRITERS))))
        segmentation = folder / f"{made.labels.name}.nii.gz"
        volume = progress.finish(stages.run("Reading", readers.read_volume_steps(segmentation)))
        results = {}
        for at, side in enumerate(SIDES):
            steps = reconstruct_steps(volume, replace(SETTINGS, stride=(side, side, 1)))
            results[side] = progress.finish(stages.run("Reconstructing", equal_part(steps, at, len(SIDES))))
        outputs = Outputs((folder / "tumour.blend", folder / "tumour.stl"), figure=folder / "tumour.png")
        shown = SETTINGS.stride[0]
        reading = Stage("Reading", stages.seconds["Reading"])
        result = replace(results[shown], stages=(reading, *results[shown].stages))
        surfaces = Surfaces(volume.name, (result,))
        surfaces, files = progress.finish(stages.run("Writing", written_steps(surfaces, outputs)))
        (results[shown],) = surfaces.results
    write_json(folder / "report.json", report(made, results, [file.name for file in files]))
    print(told(made, volume, results, [file.name for file in files], folder))


def against(made: Phantom, volume_mm3: float) -> float:
    """Return how far a volume is from the tumours' true volume, per cent of that."""
    true = sum(made.tumour_volumes_mm3)
    return 100.0 * (volume_mm3 - true) / true


def report(made: Phantom, results: dict[int, Reconstruction], files: list[str]) -> dict[str, Any]:
    """The report of the run that was written, the truth, and a row for every voxel side."""
    return results[SETTINGS.stride[0]].report() | {
        "files": files,
        "true_volume_mm3": round(sum(made.tumour_volumes_mm3), 3),
        "labelled_voxels_mm3": round(made.counted_mm3(), 3),
        "voxel_sides": [
            {
                "stride": list(result.settings.stride),
                "seconds": sum(stage.seconds for stage in result.stages),
                "full_faces": result.full_faces,
                "faces": len(result.mesh.faces),
                "volume_mm3": result.mesh.volume,
                "volume_error_percent": against(made, result.mesh.volume),
                "closed": result.mesh.closed,
            }
            for result in results.values()
        ],
    }


def told(made: Phantom, volume: Volume, results: dict[int, Reconstruction], files: list[str], folder: Path) -> str:
    """The table of stages, seconds, triangles and volumes, a column for every voxel side."""
    names = [stage.name for stage in results[SETTINGS.stride[0]].stages]
    seconds = [{stage.name: f"{stage.seconds:.3f}" for stage in result.stages} for result in results.values()]
    many = list(results.values())
    rows = [
        ("stride", *(f"{side} x {side} px" for side in results)),
        ("", *(f"{dimensions([round(side * volume.spacing[0], 2)])} mm" for side in results)),
        *((f"{name}, s", *(column.get(name, "-") for column in seconds)) for name in names),
        ("voxels visited", *(str(result.voxels_visited) for result in many)),
        ("triangles found", *(str(result.full_faces) for result in many)),
        ("triangles kept", *(str(len(result.mesh.faces)) for result in many)),
        ("volume, ml", *(f"{result.mesh.volume / 1000:.2f}" for result in many)),
        ("against the truth", *(f"{against(made, result.mesh.volume):+.1f} %" for result in many)),
        ("closed", *("yes" if result.mesh.closed else "no" for result in many)),
    ]
    true, counted = sum(made.tumour_volumes_mm3), made.counted_mm3()
    shape = f"{dimensions(volume.size)} voxels of {dimensions(volume.spacing)} mm"
    facts = [
        ("phantom", f"{shape}, {len(made.tumour_volumes_mm3)} tumours"),
        ("truth", f"{true / 1000:.2f} ml of tumour; its labelled voxels count {against(made, counted):+.1f} %"),
        ("settings", f"{command_of(SETTINGS)} (strides 1 and 3 beside it)"),
        ("", "the labels are smoothed with every sample on its own side, their volume kept; larger voxels cut corners"),
        ("files", f"{', '.join([*files, 'report.json'])}, the phantom"),
        ("", f"in {folder.parent.name}/{folder.name}"),
    ]
    return f"\n{listing(facts[:4])}\n\n{table(rows)}\n\n{listing(facts[4:])}"


if __name__ == "__main__":
    sys.exit(main())
