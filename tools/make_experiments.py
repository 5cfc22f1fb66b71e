# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `make experiments`: the paper's experiments on two phantoms and a real CT, into docs/experiments.md.

Every experiment is the command a user types; its tables and pictures stay in out/experiments/CASE/EXPERIMENT. Of the
page only what stands between the markers is renewed. The comparison sheets are the commands that stand in the page;
they stay in out/experiments/figures, and the page gets small copies of those that it shows. The real CT is not part of
the project: it is looked for beside the checkout, and without it the page keeps what was measured before.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from make_figures import render

from ctmc_addon.cli import main as ctmc

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "experiments"
PAGE = ROOT / "docs" / "experiments.md"
PICTURES = ROOT / "docs" / "pictures" / "experiments"
REAL = ROOT.parent / "shared" / "data" / "lidc0314_abdomen30"
# Bone without the couch, and without the specks of noise that any threshold finds.
BONE = ["--threshold", "200", "--close-border", "--min-part", "100"]
BONE += ["--region", "75", "130", "0", "425", "424", "29"]
TUMOR = ["--label", "2", "--smoothing-mm", "0.75"]
# Names of the cases on the page, and the settings of all their experiments.
CASES = {
    "phantom-29": ("phantom, 29 slices", TUMOR),
    "phantom-250": ("phantom, 250 slices", TUMOR),
    "abdomen": ("real CT, 30 slices", BONE),
}
EXPERIMENTS = {
    "voxels": ["--strides", "1", "2x1", "1x2", "2", "3", "--repeats", "9"],
    "rotation": [],
    "alpha": ["--no-pictures"],  # The sheets show more.
    "simplify": [],
}
FIGURES = "figures"  # Name of the sheets' folder.
# Su and Ma, table 1 (first and second set: seconds, improved efficiency in per cent) and table 2 (average, saved).
PAPER_VOXELS = {
    1: ("0.809", "", "27.292", ""),
    2: ("0.315", "61.1", "1.763", "93.5"),
    3: ("0.170", "79.0", "0.867", "96.8"),
}
PAPER_ROTATION = {0: ("3.914", ""), 50: ("3.450", "11.9"), 90: ("2.911", "25.6")}
# Plots that the page shows.
SHOWN = (
    ("phantom-250", "voxels"),
    ("abdomen", "voxels"),
    ("phantom-250", "rotation"),
    ("abdomen", "alpha"),
    ("abdomen", "simplify"),
)
Results = dict[str, dict[str, list[dict[str, Any]]]]  # Rows by case and experiment.


def main() -> int:
    """Run what was asked for, and renew the page; 0 if all went well."""
    parser = argparse.ArgumentParser(description="The paper's experiments, into docs/experiments.md.")
    parser.add_argument("--cases", nargs="+", choices=tuple(CASES), default=list(CASES))
    every = (*EXPERIMENTS, FIGURES)
    parser.add_argument("--experiments", nargs="+", choices=every, default=every)
    parser.add_argument("--only-page", action="store_true", help="measure nothing, write the page again")
    chosen = parser.parse_args()
    if not chosen.only_page:
        inputs = inputs_of(chosen.cases)
        for case in inputs:
            for experiment in [name for name in EXPERIMENTS if name in chosen.experiments]:
                print(f"\n=== {CASES[case][0]}: {experiment}\n", flush=True)
                source = inputs[case] if case == "abdomen" else inputs[case] / "volume-0.nii.gz"
                words = [str(source), *CASES[case][1], *EXPERIMENTS[experiment]]
                code = ctmc(["experiment", experiment, *words, "-o", str(OUT / case / experiment), "--overwrite"])
                if code:
                    return code
        if FIGURES in chosen.experiments:
            named = {"CT_FOLDER" if case == "abdomen" else case: path for case, path in inputs.items()}
            if code := render(PAGE, OUT / FIGURES, named):
                return code
    write_page(read_results())
    return 0


def inputs_of(cases: Sequence[str]) -> dict[str, Path]:
    """Return the folders of the cases, without a missing real CT; make missing phantoms."""
    inputs = {}
    for case in cases:
        if case != "abdomen":
            inputs[case] = OUT / case / "phantom"
            if not (inputs[case] / "truth.json").is_file():
                ctmc(["phantom", str(inputs[case]), "--slices", case.partition("-")[2], "--format", "nifti"])
        elif REAL.is_dir():
            inputs[case] = REAL
        else:
            print(f"{CASES[case][0]} is left out: there is no {REAL.name} beside the checkout")
    return inputs


def read_results() -> Results:
    """Return the rows of every experiment in out/experiments."""
    results: Results = {}
    for case in CASES:
        for experiment in EXPERIMENTS:
            table = OUT / case / experiment / "table.json"
            if table.is_file():
                results.setdefault(case, {})[experiment] = json.loads(table.read_text("utf-8"))
    return results


def write_page(results: Results) -> None:
    """Update the tables between the markers if every case has been measured, and the plots."""
    page = PAGE.read_text("utf-8")
    whole = {name: all(name in results.get(case, {}) for case in CASES) for name in EXPERIMENTS}
    sections: list[tuple[str, str, Callable[[Results], str]]] = [
        ("machine", "voxels", machine_text),
        ("table-1", "voxels", voxels_text),
        ("table-1-error", "voxels", error_text),
        ("table-2", "rotation", rotation_text),
        ("figure-8", "alpha", alpha_text),
        ("simplify", "simplify", simplify_text),
    ]
    for name, experiment, text in sections:
        if whole[experiment]:
            page = replaced(page, name, text(results))
        else:
            print(f"{name} stays as it is: {experiment} has not been measured for every case")
    PAGE.write_text(page, "utf-8")
    PICTURES.mkdir(parents=True, exist_ok=True)
    for case, experiment in SHOWN:
        plot = OUT / case / experiment / "plot.png"
        if plot.is_file():
            shutil.copyfile(plot, PICTURES / f"{experiment}-{case}.png")


def replaced(page: str, name: str, text: str) -> str:
    """Return the page with another text between the markers of that name."""
    pattern = re.compile(rf"(<!-- {name}: made by a command -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    if not pattern.search(page):
        raise SystemExit(f"{PAGE.name} has no markers named {name}")
    return pattern.sub(lambda match: f"{match[1]}\n{text}\n\n{match[2]}", page)


def as_markdown(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, all columns but the first right-aligned."""
    rule = ["---", *["--:"] * (len(titles) - 1)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (titles, rule, *rows))


def machine_text(results: Results) -> str:
    """Return the machine of all measurements."""
    row = results["phantom-29"]["voxels"][0]
    return f"{row['machine']}. {row['versions']}."


def voxels_text(results: Results) -> str:
    """Return table 1: seconds, and improved efficiency in per cent."""
    titles = ["stride, px", "paper, 29 slices"]
    titles += [CASES["phantom-29"][0], "paper, 250 slices", CASES["phantom-250"][0], CASES["abdomen"][0]]
    rows = []
    for at, row in enumerate(results["phantom-29"]["voxels"]):
        x, y, _ = row["sides_px"]
        paper = PAPER_VOXELS.get(x if x == y else 0, ("", "", "", ""))
        ours = [timed(results[case]["voxels"][at]) for case in CASES]
        rows.append([f"{x} x {y}", cell(*paper[:2]), ours[0], cell(*paper[2:]), *ours[1:]])
    return as_markdown(titles, rows)


def timed(row: dict[str, Any]) -> str:
    """Return seconds and improved efficiency of a row of table 1."""
    first = row["sides_px"][:2] == [1, 1]
    return cell(f"{row['seconds']:.4f}", "" if first else f"{row['improved_percent']:.1f}")


def cell(seconds: str, percent: str) -> str:
    """Return a cell such as '0.315 s, 61.1 %'."""
    return f"{seconds} s" * bool(seconds) + f", {percent} %" * bool(percent)


def error_text(results: Results) -> str:
    """Return the errors of larger voxels, which the paper shows only as pictures."""
    titles = ["input", "stride, px", "mm", "voxels", "triangles", "volume error", "mean, mm", "max, mm"]
    titles.append("preparing, s")
    rows = []
    for case, (name, _) in CASES.items():
        for row in results[case]["voxels"]:
            x, y, _ = row["sides_px"]
            error = row["volume_error_percent"]
            sides = " x ".join(f"{side:.2f}" for side in row["sides_mm"][:2])
            counts = [f"{row['voxels']:,}", f"{row['faces']:,}"]
            errors = ["-" if error is None else f"{error:+.2f} %", f"{row['mean_mm']:.3f}", f"{row['max_mm']:.2f}"]
            rows.append([name, f"{x} x {y}", sides, *counts, *errors, f"{row['prepare_seconds']:.4f}"])
    return as_markdown(titles, rows)


def rotation_text(results: Results) -> str:
    """Return table 2: the average of five turns, and the savings of simplification."""
    titles = ["input", "removed", "triangles", "whole frames", "saved", "drawing alone", "saved"]
    rows = [
        ["paper, 29 slices", f"{level} %", "", f"{average} s", f"{saved} %" if saved else "", "", ""]
        for level, (average, saved) in PAPER_ROTATION.items()
    ]
    for case, (name, _) in CASES.items():
        for row in results[case]["rotation"]:
            level = row["level_percent"]
            drawn = ["-", "-"]
            if row["draw_average"] is not None:
                drawn = [f"{row['draw_average']:.3f} s", f"{row['draw_saved_percent']:.1f} %" if level else ""]
            whole = [f"{row['average']:.3f} s", f"{row['saved_percent']:.1f} %" if level else ""]
            rows.append([name, f"{level} %", f"{row['faces']:,}", *whole, *drawn])
    row = results["phantom-29"]["rotation"][0]
    width, height = row["resolution"]
    said = f"{row['engine']}, off screen, {width} x {height} px, {row['frames']} frames a turn"
    return f"{as_markdown(titles, rows)}\n\n{said}, average of {len(row['rounds'])} turns."


def alpha_text(results: Results) -> str:
    """Return figure 8 in numbers."""
    titles = ["input", "alpha", "roughness", "shape", "worst shape", "volume, ml", "mean, mm", "max, mm"]
    rows = []
    for case, (name, _) in CASES.items():
        for row in results[case]["alpha"]:
            volume = "-" if row["volume_mm3"] is None else f"{row['volume_mm3'] / 1000:.2f}"
            numbers = [f"{row['roughness_deg']:.2f} deg", f"{row['shape_mean']:.3f}", f"{row['shape_worst']:.3f}"]
            rows.append([name, f"{row['alpha']:g}", *numbers, volume, f"{row['mean_mm']:.3f}", f"{row['max_mm']:.3f}"])
    return as_markdown(titles, rows)


def simplify_text(results: Results) -> str:
    """Return a comparison of both simplifiers at the same number of triangles."""
    titles = ["input", "removed", "simplifier", "triangles", "seconds", "mean, mm", "max, mm", "closed"]
    rows = []
    for case, (name, _) in CASES.items():
        for row in results[case]["simplify"]:
            errors = [f"{row['mean_mm']:.4f}", f"{row['max_mm']:.3f}", "yes" if row["closed"] else "no"]
            counts = [f"{row['faces']:,}", f"{row['seconds']:.3f}"]
            rows.append([name, f"{row['level_percent']} %", row["simplifier"], *counts, *errors])
    return as_markdown(titles, rows)


if __name__ == "__main__":
    sys.exit(main())
