# SPDX-License-Identifier: GPL-3.0-or-later
"""From a file to an STL file as a whole process: `ctmc reconstruct` against 3D Slicer's recipe in VTK."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import scenes
from .measuring import Session

SLICER, VTK = "Slicer's recipe in VTK", "VTK: flying edges, normals, STL"
FOLDERS = [str(Path(__file__).parents[up]) for up in (1, 2)]
REMOVED = 0.9  # Share of triangles to remove.


def measure(session: Session) -> None:
    """Measure all rows of this part: bone from HU of the phantom and of the largest real CT."""
    phantom = scenes.abdomen_phantom()
    stored = {"phantom": (phantom.volume.values, phantom.volume.affine)}
    real = scenes.real_ct(session.data, session.also)
    if real:
        name, largest = max(real.items(), key=lambda item: item[1].values.size)
        stored[name] = (largest.values, largest.affine)
    for name, (values, affine) in stored.items():
        source = written(session.scratch / f"{name}.nii", values, affine)
        compare(session, f"bone of {name}", source, ["--threshold", str(scenes.BONE)])
        source.unlink()


def written(path: Path, values: NDArray[Any], affine: NDArray[np.float64]) -> Path:
    """Write an uncompressed NIfTI, which both read quickly."""
    import nibabel

    nibabel.save(nibabel.Nifti1Image(values.transpose(2, 1, 0), affine), path)
    return path


def compare(
    session: Session, work: str, source: Path, inside: list[str], targets: Mapping[float, float] | None = None
) -> None:
    """Compare with all triangles, and with nine of ten removed; CTMC has one thread, as most of the recipe has."""
    for removed in (0.0, REMOVED):
        ours = [*inside, "--threads", "1", *(["--simplify", str(removed)] if removed else [])]
        theirs = [*inside, *(["--decimate", str(removed)] if removed else [])]
        out = session.scratch / "process.stl"
        peers = {SLICER: (lambda t=theirs, o=out: recipe(source, o, t), (targets or {}).get(removed))}
        if inside[0] == "--threshold" and not removed:
            peers[VTK] = (lambda t=theirs, o=out: recipe(source, o, [*t, "--bare"]), None)
        counts = [reconstruct(source, out, ours), *(call() for call, _ in peers.values())]
        session.compare(
            f"{work}, NIfTI to STL, whole process" + (f", {removed:.0%} removed" if removed else ""),
            lambda o=ours, p=out: reconstruct(source, p, o),
            peers,
            note=" and ".join(f"{count / 1e3:.0f}k" for count in counts) + " triangles",
            repeats=max(1, session.repeats // 3),
            warm=False,  # the files were read when triangles were counted
        )


def reconstruct(source: Path, out: Path, words: list[str]) -> int:
    """Run `ctmc reconstruct`; return the number of triangles."""
    return run(["ctmc_addon", "reconstruct", str(source), "-o", str(out), *words], out)


def recipe(source: Path, out: Path, words: list[str]) -> int:
    """Run VTK's process; return the number of triangles."""
    return run(["benchmarks.slicer_recipe", str(source), str(out), *words], out)


def run(module_and_words: list[str], out: Path | None) -> int:
    """Run a module in a fresh Python and look into the STL it made, if it makes one."""
    if out is not None:
        out.unlink(missing_ok=True)
    # This checkout and the benchmark, wherever the process starts.
    settings = {**os.environ, "PYTHONPATH": os.pathsep.join([*FOLDERS, os.environ.get("PYTHONPATH", "")])}
    settings.pop("PYTHONDONTWRITEBYTECODE", None)  # as installed: the bytecode of NumPy and VTK is there as well
    command = [sys.executable, "-m", *module_and_words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=settings)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return 0 if out is None else int(np.fromfile(out, "<u4", 1, offset=80)[0])
