# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure this project and its peers in one run; print the rows, keep them in out/bench/bench.json.

Run by `make bench`, which makes the environment (environment.py). Every part runs in a process of its own, so
that no part inherits another's memory, threads or Blender.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path
from typing import Any

from . import documents
from .measuring import Row, Session
from .peers import versions

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "out" / "bench" / "bench.json"
PARTS = {  # Module and subject by name.
    "extraction": "against VTK, scikit-image, PyMCubes; strides; memory",
    "patient": "bone, skin and masks against VTK and Blender's own mesher",
    "simplify": "quadric error metrics against VTK, Blender's Decimate and others",
    "small_components": "simplification of surfaces with thousands of small components",
    "bounds": "simplification to a greatest error in millimeters",
    "surface_distances": "signed distances to a surface against libigl, VTK, trimesh",
    "many_labels": "104 labels at once against the largest alone; a patient's organs with shared walls",
    "painting": "values of another volume at 1M vertices",
    "thickness": "thickness of walls against trimesh and libigl",
    "solids": "organs cut and hollow against Blender's Boolean and Solidify, and manifold3d",
    "reading": "DICOM folders against SimpleITK",
    "livers": "the start of ctmc; livers from labels to STL against 3D Slicer's recipe, whole processes",
    "processes": "bone from a file to an STL file against 3D Slicer's recipe in VTK, whole processes",
    "blender": "folder to object in a process of its own; alpha on 1M vertices",
    "growth": "time and memory over size, triangles, threads, stride",
}
WORK, PEER = 98, 40  # Widths of the printed columns.


def main() -> int:
    """Run the requested parts; return 0 even if targets are missed, because a slow minute is not a defect."""
    options = arguments()
    if options.part:
        return child(options)
    busy = machine()["load"]
    if busy and busy > 1 and not options.shared:
        print(f"# The machine is busy (load {busy:.1f}): --shared measures processor time")
    print(header(), flush=True)
    status = 0
    with tempfile.TemporaryDirectory(prefix="ctmc-bench-") as scratch:
        for part in options.only or PARTS:
            answer = Path(scratch) / f"{part}.json"
            about = {"command": command(options), "machine": machine()}
            done = subprocess.run(child_command(options, part, Path(scratch), answer), check=False)
            if not answer.exists():
                print(f"The part {part} ended with status {done.returncode} and without a result", file=sys.stderr)
                status = 1
                continue
            keep(part, about | json.loads(answer.read_text()))
    results = kept()
    judged = [row["met"] for part_results in results.values() for row in part_results["rows"] if row["met"] is not None]
    print(f"{sum(judged)} of {len(judged)} targets met; all numbers are in {RESULTS}")
    if options.write_docs:
        for path in documents.write(results):
            print(f"written: {path.relative_to(ROOT)}")
    return status


def kept() -> dict[str, dict[str, Any]]:
    """Return the stored results of all measured parts, in their order."""
    stored = json.loads(RESULTS.read_text())["parts"] if RESULTS.exists() else {}
    return {part: stored[part] for part in PARTS if part in stored}


def keep(part: str, results: dict[str, Any]) -> None:
    """Store a part's numbers at once, so that an interrupted run loses only one part."""
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text(json.dumps({"parts": {**kept(), part: results}}, indent=1) + "\n")


def arguments() -> argparse.Namespace:
    """Return the parser of the options."""
    parser = argparse.ArgumentParser(prog="make bench ARGS=...", description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=PARTS, action="append", help="run this part only; may be given again")
    parser.add_argument("--quick", action="store_true", help="3 calls instead of 9, for a first look")
    parser.add_argument("--repeats", type=int, help="calls of which the median counts")
    parser.add_argument(
        "--shared", action="store_true", help="others use the machine: processor time, least of the calls, one thread"
    )
    parser.add_argument("--row-seconds", type=float, default=60, help="begin no further round of a row after so long")
    parser.add_argument("--ct", type=Path, action="append", default=[], help="a CT of your own to measure as well")
    parser.add_argument(
        "--write-docs", action="store_true", help="renew docs/development/performance.md, of the parts in bench.json"
    )
    hidden = {"help": argparse.SUPPRESS}
    parser.add_argument("--part", **hidden)
    parser.add_argument("--scratch", type=Path, **hidden)
    parser.add_argument("--answer", type=Path, **hidden)
    options = parser.parse_args()
    options.repeats = options.repeats or (3 if options.quick else 9)
    return options


def command(options: argparse.Namespace) -> str:
    """Return the command that repeats this run."""
    given = " ".join(word for word in sys.argv[1:] if word != "--write-docs")
    return f"make bench ARGS='{given}'" if given else "make bench"


def child_command(options: argparse.Namespace, part: str, scratch: Path, answer: Path) -> list[str]:
    """Return the command that runs one part."""
    asked = [sys.executable, "-m", "benchmarks.bench", "--part", part, "--repeats", str(options.repeats)]
    asked += ["--scratch", str(scratch), "--answer", str(answer), "--row-seconds", str(options.row_seconds)]
    asked += ["--shared"] if options.shared else []
    return asked + [word for path in options.ct for word in ("--ct", str(path))]


def child(options: argparse.Namespace) -> int:
    """Run one part and leave at once: Blender as a module may hang while Python shuts down."""
    session = Session(
        part=options.part,
        repeats=options.repeats,
        show=lambda row: print(line(row), flush=True),
        say=lambda sentence: print(f"# {sentence}", flush=True),
        scratch=options.scratch,
        data=ROOT.parent / "shared" / "data",
        also=options.ct,
        shared=options.shared,
        row_seconds=options.row_seconds,
    )
    importlib.import_module(f"benchmarks.{options.part}").measure(session)
    answer = {"rows": [row.as_dict() for row in session.rows], "facts": session.facts}
    options.answer.write_text(json.dumps(answer))
    sys.stdout.flush()
    os._exit(0)


def header() -> str:
    """Return the names of the columns."""
    return f"{'work':{WORK}}  {'peer':{PEER}}  {'ours_s':>9}  {'peer_s':>9}  {'ratio':>6}  target"


def line(row: Row) -> str:
    """Return the printed line of a row; values other than seconds have their unit."""
    work = row.work if row.unit == "s" else f"{row.work}, {row.unit}"
    target = "" if row.target is None else f"{row.target:.2f}  {row.verdict}"
    note = f"  ({row.note})" if row.note else ""
    return f"{work:{WORK}}  {row.peer:{PEER}}  {row.ours:9.4g}  {row.theirs:9.4g}  {row.ratio:6.3f}  {target}{note}"


def machine() -> dict[str, Any]:
    """Return machine, date and versions."""
    name, memory = platform.processor() or platform.machine(), ""
    try:
        for entry in Path("/proc/cpuinfo").read_text().splitlines():
            if entry.startswith("model name"):
                name = entry.partition(":")[2].strip()
                break
        kilobytes = int(Path("/proc/meminfo").read_text().split()[1])
        memory = f"{kilobytes / 2**20:.0f} GiB"
    except OSError:
        pass
    return {
        "date": date.today().isoformat(),
        "processor": name,
        "cores": os.cpu_count(),
        "memory": memory,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": versions(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    }


if __name__ == "__main__":
    sys.exit(main())
