# SPDX-License-Identifier: GPL-3.0-or-later
"""Put a run's numbers into docs/development/performance.md, between its markers, and draw the growth of cost.

What stands outside the markers is written by hand and stays.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "development" / "performance.md"
PICTURE = ROOT / "docs" / "pictures" / "growth.png"
WITH_ROWS = (
    "extraction",
    "patient",
    "many_labels",
    "simplify",
    "small_components",
    "bounds",
    "thickness",
    "solids",
    "reading",
    "livers",
    "processes",
    "blender",
)
"""Parts that have rows on the page."""


def write(results: dict[str, Any]) -> list[Path]:
    """Update the page's text on every measured part, and the picture; return the written files."""
    sections = {"run": run_text([part["machine"] for part in results.values()][-1])}
    for part in WITH_ROWS:
        if part in results:
            sections[f"the rows of {part}"] = rows_text(results[part])
    extraction = results["extraction"]["facts"] if "extraction" in results else {}
    if "stages" in extraction:
        sections["stages"] = stages_text(extraction["stages"], extraction["bandwidth"])
    written = [PAGE]
    if "growth" in results:
        sections["growth"] = growth_text(results["growth"]["facts"])
        draw(results["growth"]["facts"], PICTURE)
        written.append(PICTURE)
    page = PAGE.read_text(encoding="utf-8")
    for name, text in sections.items():
        page = replaced(page, name, text)
    PAGE.write_text(page, encoding="utf-8")
    return written


def replaced(page: str, name: str, text: str) -> str:
    """Return the page with another text between the markers of this name."""
    pattern = re.compile(rf"(<!-- {name}: made by a command -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    if not pattern.search(page):
        raise ValueError(f"the page has no markers for {name}")
    return pattern.sub(lambda match: f"{match[1]}\n{text.strip()}\n\n{match[2]}", page)


def table(names: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table; all columns but the first two are right-aligned."""
    rule = ["---", "---", *["--:"] * (len(names) - 2)]
    return "\n".join("| " + " | ".join(row) + " |" for row in [names, rule, *rows])


def run_text(machine: dict[str, Any]) -> str:
    """Return the machine and the versions of the peers."""
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    return (
        f"{machine['processor']}, {machine['cores']} cores, {machine['memory']}, {machine['system']}, "
        f"Python {machine['python']}. {versions}."
    )


def rows_text(results: dict[str, Any]) -> str:
    """Return date, command and machine of a part, and its rows without targets."""
    machine = results["machine"]
    load = machine["load"] or 0
    busy = f", load {load:.0f} at the start" if load > 1 else ""
    lines = [row_cells(row) for row in results["rows"]]
    where = f"{machine['processor']}, {machine['cores']} cores"
    return f"{machine['date']}, `{results['command']}`, {where}{busy}.\n\n" + table(
        ["work", "peer", "CTMC", "peer", "ratio"], lines
    )


def row_cells(row: dict[str, Any]) -> list[str]:
    """Return the cells of a row."""
    work = f"{row['work']} ({row['note']})" if row["note"] else row["work"]
    values = [f"{row[name]:.3g} {row['unit']}" for name in ("ours_s", "peer_s")]
    return [work, row["peer"], *values, f"{row['ratio']:.2f}"]


def stages_text(stages: dict[str, list[dict[str, Any]]], widths: dict[str, dict[str, float]]) -> str:
    """Return a table of extraction stages against the memory's bandwidth."""
    speeds = "; ".join(
        f"{threads} thread{'s' if threads != '1' else ''}: {width['read'] / 1e9:.1f} GB/s read, "
        f"{width['write'] / 1e9:.1f} GB/s written"
        for threads, width in widths.items()
    )
    rows = []
    for scene, parts in stages.items():
        for part in parts:
            has_bound = part["least_seconds"] is not None
            moved = f"{(part['read'] + part['written']) / 1e6:.0f} MB" if has_bound else ""
            least = f"{part['least_seconds'] * 1e3:.1f} ms" if has_bound else ""
            times = f"{part['seconds'] / part['least_seconds']:.1f}" if has_bound else ""
            rows.append([scene, part["stage"], f"{part['seconds'] * 1e3:.1f} ms", moved, least, times])
    names = ["scene", "stage", "measured", "bytes at least", "at bandwidth", "times the limit"]
    return f"Bandwidth in the same run, {speeds}.\n\n{table(names, rows)}"


def growth_text(growth: dict[str, Any]) -> str:
    """Return the time per voxel and per triangle, and the effect of threads."""
    threads = [
        [
            point["scene"],
            str(point["threads"]),
            f"{point['seconds'] * 1e3:.0f} ms",
            f"{point['vtk_seconds'] * 1e3:.0f} ms",
        ]
        for point in growth["threads"]
    ]
    return "\n\n".join(
        [
            f"![Time and memory over size, triangles, stride and threads](../pictures/{PICTURE.name})",
            "\n".join(f"- {sentence[0].upper()}{sentence[1:]}." for sentence in growth["summary"]),
            table(["scene", "threads", "CTMC", "vtkFlyingEdges3D"], threads),
        ]
    )


def draw(growth: dict[str, Any], path: Path) -> None:
    """Draw time above and memory below, over four quantities."""
    import matplotlib

    matplotlib.use("agg")
    look = {"font.size": 8, "axes.grid": True, "grid.alpha": 0.3}
    matplotlib.rcParams.update(look)
    from matplotlib import pyplot
    from PIL import Image

    figure, panels = pyplot.subplots(2, 4, figsize=(13, 5.4), layout="constrained")
    series = (
        ("size", "a ball in a cube of 64³ to 512³", "million voxels", "voxels", 1e6),
        ("triangles", "1 to 512 balls in a cube of 320³", "million triangles", "triangles", 1e6),
        ("stride", "dense CT, strides 1 x 1 to 8 x 8", "million voxels", "voxels", 1e6),
        ("threads", "threads, dense CT", "threads", "threads", 1),
    )
    for at, (name, title, label, over, unit) in enumerate(series):
        points = [point for point in growth[name] if point.get("scene", "dense") == "dense"]
        x = [point[over] / unit for point in points]
        time, memory = panels[:, at]
        for of, who, color in (("seconds", "CTMC", "tab:red"), ("vtk_seconds", "VTK", "tab:gray")):
            if of in points[0]:
                time.plot(x, [point[of] * 1e3 for point in points], "o-", label=who, color=color, markersize=3)
        memory.plot(x, [point["peak_bytes"] / 2**20 for point in points], "o-", color="tab:red", markersize=3)
        time.set(title=title, ylabel="ms")
        memory.set(xlabel=label, ylabel="MiB beside the result")
        if name == "threads":
            memory.set_xticks(x)
            time.set_xticks(x)
        for panel in (time, memory):
            panel.set_ylim(bottom=0)
        time.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = io.BytesIO()
    figure.savefig(picture, dpi=100)
    pyplot.close(figure)
    Image.open(picture).convert("RGB").quantize(32).save(path, optimize=True)  # a third of the bytes
