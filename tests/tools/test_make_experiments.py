# SPDX-License-Identifier: GPL-3.0-or-later
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.once


@pytest.fixture
def tool(load_tool):
    return load_tool("make_experiments")


@pytest.fixture
def found(tool):
    """Numbers of no machine, for every case and experiment."""
    machine_facts = {"machine": "a processor", "versions": "some versions"}
    voxels = [
        {"sides_px": [x, y, 1], "sides_mm": [0.5 * x, 0.5 * y, 1.0], "seconds": 0.8 / (x * y), "faces": 1000 // (x * y),
         "improved_percent": 100 * (1 - 1 / (x * y)), "voxels": 9000 // (x * y), "volume_error_percent": None,
         "mean_mm": 0.1, "max_mm": 1.0, "prepare_seconds": 0.01, **machine_facts}
        for x, y in ((1, 1), (2, 1), (2, 2), (3, 3))
    ]  # fmt: skip
    rotation = [
        {"level_percent": level, "faces": 1000, "average": 2.0, "saved_percent": 12.5, "draw_average": None,
         "draw_saved_percent": None, "resolution": [640, 480], "engine": "Cycles", "frames": 18, "rounds": [2.0] * 5}
        for level in (0, 50)
    ]  # fmt: skip
    alpha = [
        {"alpha": 0.25, "roughness_deg": 9.0, "shape_mean": 0.8, "shape_worst": 0.1, "volume_mm3": 2500.0,
         "mean_mm": 0.1, "max_mm": 0.2}
    ]  # fmt: skip
    simplify = [
        {"level_percent": 50, "simplifier": "built-in", "faces": 500, "seconds": 0.5, "mean_mm": 0.1, "max_mm": 0.2,
         "closed": True}
    ]  # fmt: skip
    return {case: {"voxels": voxels, "rotation": rotation, "alpha": alpha, "simplify": simplify} for case in tool.CASES}


def test_the_page_is_renewed_between_its_markers_and_nowhere_else(tool, found, tmp_path, monkeypatch):
    for name in ("PAGE", "PICTURES", "OUT"):
        monkeypatch.setattr(tool, name, tmp_path / name)
    before = (ROOT / "docs" / "experiments.md").read_text("utf-8")
    (tmp_path / "PAGE").write_text(before, "utf-8")
    tool.write_page(found)
    after = (tmp_path / "PAGE").read_text("utf-8")
    marked = re.compile(r"(?<=made by a command -->\n).*?(?=<!-- end of)", re.DOTALL)
    assert marked.sub("", after) == marked.sub("", before)
    assert len(marked.findall(after)) == 6
    assert "a processor. some versions." in after
    assert (
        "| 2 x 2 | 0.315 s, 61.1 % | 0.2000 s, 75.0 % | 1.763 s, 93.5 % | 0.2000 s, 75.0 % | 0.2000 s, 75.0 % |"
        in after
    )
    assert "| 2 x 1 |  | 0.4000 s, 50.0 % |  | 0.4000 s, 50.0 % | 0.4000 s, 50.0 % |" in after
    assert "Cycles, off screen, 640 x 480 px, 18 frames a turn, average of 5 turns." in after


def test_what_was_not_measured_keeps_its_old_numbers(tool, found, tmp_path, monkeypatch, capfd):
    for name in ("PAGE", "PICTURES", "OUT"):
        monkeypatch.setattr(tool, name, tmp_path / name)
    (tmp_path / "PAGE").write_text((ROOT / "docs" / "experiments.md").read_text("utf-8"), "utf-8")
    tool.write_page(found)
    full = (tmp_path / "PAGE").read_text("utf-8")
    del found["abdomen"]
    tool.write_page(found)
    assert (tmp_path / "PAGE").read_text("utf-8") == full
    assert "table-1 stays as it is" in capfd.readouterr().out


@pytest.mark.parametrize("page", ["experiments.md", "figures.md"])
def test_the_pictures_that_a_page_shows_are_there(page):
    for name in re.findall(r"\]\((pictures/[^)]+)\)", (ROOT / "docs" / page).read_text("utf-8")):
        start = b"\xff\xd8\xff" if name.endswith(".jpg") else b"\x89PNG\r\n\x1a\n"
        assert (ROOT / "docs" / name).read_bytes().startswith(start), name


def test_the_figures_are_those_of_the_commands_in_the_page(tool, load_tool, tmp_path, monkeypatch):
    figures = load_tool("make_figures")
    ran = []
    monkeypatch.setattr(figures, "ctmc", ran.append)
    monkeypatch.setattr(figures, "shrink", lambda source, target: (tmp_path / target.name).write_bytes(b""))
    figures.render(tool.PAGE, tmp_path / "out", {"phantom-29": Path("a"), "CT_FOLDER": Path("b", "c")})
    assert [(words[0], words[1], words[2], Path(words[words.index("-o") + 1]).name) for words in ran] == [
        ("figure", "sheet", str(Path("a", "volume-0.nii.gz")), "figure-6.png"),
        ("figure", "sheet", str(Path("b", "c")), "figure-6-real.png"),
        ("figure", "sheet", str(Path("a", "volume-0.nii.gz")), "figure-8-29.png"),
        ("figure", "sheet", str(Path("b", "c")), "figure-8-real.png"),
    ]
    # Pictures of a real CT stay out of the page.
    assert sorted(path.name for path in tmp_path.glob("*.jpg")) == ["figure-6.jpg", "figure-8-29.jpg"]
    assert not [name for name in re.findall(r"pictures/[^)]+", tool.PAGE.read_text("utf-8")) if "real" in name]
