"""Put a run's numbers into docs/performance.md, between its markers, and draw the growth of cost.

What stands outside the markers is written by hand and stays.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "performance.md"
PICTURE = ROOT / "docs" / "pictures" / "growth.svg"
TITLES = {
    "extraction": "Extraction",
    "simplify": "Simplification",
    "reading": "Reading",
    "blender": "In Blender",
}


def write(found: dict[str, Any]) -> list[Path]:
    """Renew the page and its picture; returns what was written."""
    facts = found["facts"]
    extraction = facts.get("extraction", {})
    sections = {"run": run_text(found["machine"], found["command"]), "rows": rows_text(found["rows"])}
    if "stages" in extraction:
        sections["stages"] = stages_text(extraction["stages"], extraction["bandwidth"])
    written = [PAGE]
    if "growth" in facts:
        sections["growth"] = growth_text(facts["growth"])
        draw(facts["growth"], PICTURE)
        written.append(PICTURE)
    page = PAGE.read_text(encoding="utf-8")
    for name, text in sections.items():
        page = replaced(page, name, text)
    PAGE.write_text(page, encoding="utf-8")
    return written


def replaced(page: str, name: str, text: str) -> str:
    """The page with another text between the markers of this name."""
    pattern = re.compile(rf"(<!-- {name}: made by a command -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    if not pattern.search(page):
        raise ValueError(f"the page has no markers for {name}")
    return pattern.sub(lambda found: f"{found[1]}\n{text.strip()}\n\n{found[2]}", page)


def table(names: list[str], rows: list[list[str]]) -> str:
    """A Markdown table; all columns but the first two stand right."""
    rule = ["---", "---", *["--:"] * (len(names) - 2)]
    return "\n".join("| " + " | ".join(row) + " |" for row in [names, rule, *rows])


def run_text(machine: dict[str, Any], command: str) -> str:
    """Where, when and how it was measured."""
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    return (
        f"{machine['date']}, `{command}`: {machine['processor']}, {machine['cores']} cores, {machine['memory']}, "
        f"{machine['system']}, Python {machine['python']}. {versions}."
    )


def rows_text(rows: list[dict[str, Any]]) -> str:
    """A table for every part, and how many targets are met."""
    judged = [row["met"] for row in rows if row["met"] is not None]
    texts = [f"{sum(judged)} of {len(judged)} targets are met."]
    for part, title in TITLES.items():
        lines = [row_cells(row) for row in rows if row["part"] == part]
        if lines:
            texts.append(f"### {title}\n\n" + table(["work", "peer", "CTMC", "peer", "ratio", "target"], lines))
    return "\n\n".join(texts)


def row_cells(row: dict[str, Any]) -> list[str]:
    """One row's cells."""
    target = "" if row["target"] is None else f"{row['target']:g}, {'met' if row['met'] else '**not met**'}"
    work = f"{row['work']} ({row['note']})" if row["note"] else row["work"]
    values = [f"{row[name]:.3g} {row['unit']}" for name in ("ours_s", "peer_s")]
    return [work, row["peer"], *values, f"{row['ratio']:.2f}", target]


def stages_text(stages: dict[str, list[dict[str, Any]]], widths: dict[str, dict[str, float]]) -> str:
    """How far each stage of extraction stands from what the memory allows."""
    speeds = "; ".join(
        f"{threads} thread{'s' if threads != '1' else ''}: {width['read'] / 1e9:.1f} GB/s read, "
        f"{width['write'] / 1e9:.1f} GB/s written"
        for threads, width in widths.items()
    )
    rows = []
    for scene, parts in stages.items():
        for part in parts:
            known = part["least_seconds"] is not None
            moved = f"{(part['read'] + part['written']) / 1e6:.0f} MB" if known else ""
            least = f"{part['least_seconds'] * 1e3:.1f} ms" if known else ""
            times = f"{part['seconds'] / part['least_seconds']:.1f}" if known else ""
            rows.append([scene, part["stage"], f"{part['seconds'] * 1e3:.1f} ms", moved, least, times])
    names = ["scene", "stage", "measured", "bytes at least", "at bandwidth", "times the limit"]
    return f"Bandwidth in the same run, {speeds}.\n\n{table(names, rows)}"


def growth_text(growth: dict[str, Any]) -> str:
    """The prices of a voxel and a triangle, and threads."""
    rows = [
        [point["scene"], str(point["threads"]), f"{point['seconds']:.3f} s", f"{point['vtk_seconds']:.3f} s"]
        for point in growth["threads"]
    ]
    peaks = [
        [f"{point['side']}³", "", f"{point['bytes'] / 2**20:.1f} MiB", f"{point['peak_bytes'] / 2**20:.1f} MiB"]
        for point in growth["size"]
    ]
    return "\n\n".join(
        [
            f"![Time and memory over size, triangles, threads and stride](pictures/{PICTURE.name})",
            "\n".join(f"- {sentence[0].upper()}{sentence[1:]}." for sentence in growth["summary"]),
            table(["scene", "threads", "CTMC", "vtkFlyingEdges3D"], rows),
            table(["volume", "", "its size", "memory beside the result"], peaks),
        ]
    )


def draw(growth: dict[str, Any], path: Path) -> None:
    """Four panels as SVG; the same numbers give the same file."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "ctmc", "font.size": 8, "axes.grid": True, "grid.alpha": 0.3})
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 4, figsize=(13, 3.2), layout="constrained")
    size, triangles, stride = growth["size"], growth["triangles"], growth["stride"]

    def lines(panel: object, points: list[dict[str, Any]], over: str, scale: float) -> None:
        x = [point[over] / scale for point in points]
        for name, label, colour in (("seconds", "CTMC", "tab:red"), ("vtk_seconds", "VTK", "tab:gray")):
            if name in points[0]:
                panel.plot(x, [point[name] * 1e3 for point in points], "o-", label=label, color=colour, markersize=3)

    lines(panels[0], size, "voxels", 1e6)
    panels[0].set(title="a ball in a cube of 64 to 512, 1 thread", xlabel="million voxels", ylabel="ms")
    lines(panels[1], triangles, "triangles", 1e6)
    panels[1].set(title="1 to 512 balls in one cube, 1 thread", xlabel="million triangles", ylabel="ms")
    lines(panels[2], stride, "voxels", 1e6)
    panels[2].set(title="dense CT, strides 1 to 8, 1 thread", xlabel="million voxels", ylabel="ms")
    x = [point["bytes"] / 2**20 for point in size]
    panels[3].plot(x, [point["peak_bytes"] / 2**20 for point in size], "o-", color="tab:red", markersize=3)
    panels[3].set(title="memory beside the result", xlabel="MiB of volume", ylabel="MiB")
    for panel in panels:
        panel.set_xlim(left=0)
        panel.set_ylim(bottom=0)
    for panel in panels[:2]:
        panel.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None, "Creator": None})
    pyplot.close(figure)
