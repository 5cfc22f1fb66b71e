# SPDX-License-Identifier: GPL-3.0-or-later
"""What the documents show is what happens: their examples are run, their links lead somewhere."""

from __future__ import annotations

import doctest
import itertools
import json
import os
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.cli import main
from ctmc_addon.cli.program import parser
from ctmc_addon.readers import read_volume

ROOT = Path(__file__).resolve().parents[1]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
pytestmark = pytest.mark.once

SMALLER = {"phantom": ["--slices", "8", "--size", "64"]}
MADE = re.compile(r"<!-- [^>]+: made by a command -->.*?<!-- end of [^>]+ -->", re.DOTALL)


@pytest.mark.parametrize(
    ("page", "most"),
    [
        ("README.md", 600),
        ("docs/architecture.md", 900),
        ("docs/development/accuracy.md", 900),
        ("docs/development/performance.md", 900),
        ("docs/index.md", 3400),
        ("docs/experiments.md", 1500),
        ("docs/segmenting.md", 2300),
    ],
)
def test_a_page_has_few_words_beside_its_made_tables(page, most):
    assert len(MADE.sub("", (ROOT / page).read_text(encoding="utf-8")).split()) <= most


def test_the_changelog_has_at_most_150_lines():
    assert len((ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_every_file_that_the_architecture_page_names_exists():
    named = re.findall(r"`([a-z_/]+\.py|[a-z_/]+/)`", (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8"))
    paths = [path.relative_to(ROOT).as_posix() for path in (ROOT / "ctmc_addon").rglob("*")]
    paths += [path.relative_to(ROOT).as_posix() for path in (ROOT / "tests").glob("*")] + ["tests"]
    assert len(named) > 30
    assert [name for name in named if not any(f"/{path}".endswith("/" + name.strip("/")) for path in paths)] == []


def test_the_voxel_of_the_architecture_page_goes_the_way_it_says():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").replace("```", "")
    example = doctest.DocTestParser().get_doctest(text.replace("pycon\n", "\n"), {}, "architecture.md", None, 0)
    outcome = doctest.DocTestRunner().run(example)
    assert (outcome.failed, outcome.attempted) == (0, 21)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files(page):
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8"))
    missing = [target for target in targets if "://" not in target and not (page.parent / target).exists()]
    assert missing == []


def anchors_of(page):
    """The anchors of a page's headings, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", line) for line in re.findall(r"^#+ (.*)$", text, re.MULTILINE)]
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_to_headings_lead_to_one(page):
    links = re.findall(r"\]\(([^)#:]*)#([^)]+)\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if link[1] not in anchors_of(page.parent / link[0] if link[0] else page)]
    assert missing == []


def test_every_page_is_in_the_list_of_the_site():
    listed = re.findall(r": ([\w/.-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    made = {"gallery.md", "python.md", "contributing.md", "changelog.md", "security.md"}  # by tools/site_hooks.py
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    assert sorted(listed) == sorted(pages | made)


def commands_of(page):
    """The command lines in a page's blocks of code, as words."""
    text = page.read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"^```\w*\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)).replace("\\\n", " ")
    return [shlex.split(line, comments=True) for line in re.findall(r"^ctmc .*$", blocks, re.MULTILINE)]


@pytest.mark.parametrize(
    "page", [page for page in PAGES if commands_of(page)], ids=lambda page: page.relative_to(ROOT).as_posix()
)
def test_every_command_of_a_page_is_one_that_ctmc_knows(page):
    for words in commands_of(page):
        own = list(itertools.takewhile(lambda word: word not in (">", "&", "|"), words[1:]))
        parser(own[0]).parse_args(own)  # leaves with a message where a flag is unknown


@pytest.fixture(scope="module")
def readme_folder(tmp_path_factory):
    """A folder in which the command lines of README and the manual's first page were run, on a smaller phantom."""
    folder = tmp_path_factory.mktemp("readme")
    shown = [*commands_of(ROOT / "README.md"), *commands_of(ROOT / "docs" / "index.md")]
    lines = [list(words) for words in dict.fromkeys(map(tuple, shown)) if words[1] != "figure"]
    before = Path.cwd()
    os.chdir(folder)
    try:
        codes = [main([*words[1:], *SMALLER.get(words[1], [])]) for words in lines]
    finally:
        os.chdir(before)
    assert len(codes) == 10
    assert set(codes) == {0}
    return folder


def page_of(name):
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def test_the_command_lines_of_the_simulation_page_choose_an_alpha(readme_folder, monkeypatch):
    lines = [line for line in page_of("simulation.md").splitlines() if line.startswith("ctmc reconstruct ct/")]
    monkeypatch.chdir(readme_folder)
    assert [main(shlex.split(line)[1:]) for line in lines] == [0, 0, 0]
    report = json.loads((readme_folder / "tumor.json").read_text(encoding="utf-8"))
    assert 0 < report["alpha"] == report["alpha_choice"]["alpha"] < 1
    assert (report["smallest_angle_deg"] >= 5, report["below_5_deg"], report["closed"]) == (True, 0, True)
    table = re.findall(r"^\| `([a-z0-9_]+)`(?:, `([a-z0-9_]+)`)? \|", page_of("simulation.md"), re.MULTILINE)
    assert {key for keys in table for key in keys if key} <= set(report)


def test_the_python_of_the_simulation_page_makes_tetrahedra(readme_folder, monkeypatch, capsys):
    pyvista = pytest.importorskip("pyvista")
    pytest.importorskip("tetgen")
    (code,) = re.findall(r"```python\n(.*?)```", page_of("simulation.md"), re.DOTALL)
    assert len(code.split("\n\n")[1].strip().splitlines()) <= 10
    monkeypatch.chdir(readme_folder)
    exec(compile(code, "simulation.md", "exec"), {})
    words = r"(\d+) tetrahedra in RAS\+ mm, (\d+) mm3 of (\d+)\n"
    count, filled, enclosed = map(int, re.search(words, capsys.readouterr().out).groups())
    grid = pyvista.read(readme_folder / "tumor.vtu")
    assert grid.n_cells == count > 1000
    assert filled == pytest.approx(enclosed, rel=1e-3)
    assert grid.volume == pytest.approx(enclosed, rel=1e-3)


def test_the_command_lines_of_the_segmenting_page_make_labels(tmp_path, monkeypatch):
    page = page_of("segmenting.md").partition("## Four structures of a patient")[0]  # that one is not in the tests
    lines = [line for line in page.splitlines() if re.match(r"ctmc (segment|reconstruct) ", line)]
    monkeypatch.chdir(tmp_path)
    # Pixels as small and as noisy as those of the page's phantom: larger ones average the noise away.
    assert main(["phantom", "ct", "--format", "all", "--slices", "8"]) == 0
    assert [main(shlex.split(line)[1:]) for line in lines] == [0, 0, 0, 0]
    volumes = {name: read_volume(f"{name}.seg.nrrd") for name in ("tumor", "organs", "ablation")}
    assert list(volumes["organs"].label_names.values()) == ["tumor", "liver"]
    tumor, ablation = (int((volumes[name].values == 1).sum()) for name in ("tumor", "ablation"))
    assert 0 < tumor < ablation
    liver = np.logical_or.reduce([layer.values == 2 for layer in volumes["organs"].each_layer])
    truth = read_volume("ct/segmentation-0.nii.gz").values == 1
    assert 2 * (liver & truth).sum() / (liver.sum() + truth.sum()) > 0.95  # Dice


def test_the_python_of_the_segmenting_page_runs(readme_folder, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", page_of("segmenting.md"), re.DOTALL)
    monkeypatch.chdir(readme_folder)
    exec(compile(code, "segmenting.md", "exec"), {})
    words = r"(\d+) voxels, (\d+) with a margin; (\d+) by the brush\n(\d+) bytes of undo\n"
    tumor, grown, brushed, undo = map(int, re.fullmatch(words, capsys.readouterr().out).groups())
    assert 0 < tumor < grown
    assert 0 < brushed < grown
    assert 16 <= undo <= 16 * brushed


@pytest.mark.parametrize(
    ("page", "made"),
    [
        ("coming-from.md", ["organs.glb"]),
        ("interfaces.md", ["touching/label 2.ply", "organs.json"]),
        ("batch.md", ["cohort/summary.html", "liver.toml"]),
    ],
)
def test_the_commands_of_a_page_run(page, made, readme_folder, monkeypatch, capsys):
    monkeypatch.chdir(readme_folder)
    # Outputs of their own: those of README are looked at by another test.
    ours = {"lits/": "ct", "labels.nii.gz": "ct/segmentation-0.nii.gz", "organs/": "touching/", "out": "cohort"}
    shown = [[ours.get(word, word) for word in words[1:]] for words in commands_of(ROOT / "docs" / page)]
    for words in shown[1:3] if page == "batch.md" else shown:  # one batch is enough
        capsys.readouterr()
        own = list(itertools.takewhile(lambda word: word not in (">", "&"), words))
        assert main(own) == 0
        if ">" in words:
            Path(words[-1]).write_text(capsys.readouterr().out, encoding="utf-8")
    assert [name for name in made if not Path(name).is_file()] == []


def test_the_command_lines_of_readme_and_manual_make_what_they_say(readme_folder):
    made = {path.name for path in readme_folder.iterdir()}
    assert {"ct", "bone.stl", "tumor.ply", "liver.stl", "organs", "patient.html", "out"} <= made
    assert {"tumor.seg.nrrd", "table.csv"} <= made
    assert len(list((readme_folder / "organs").glob("*.stl"))) == 2
    header, count = (readme_folder / "bone.stl").read_bytes()[80:84], (readme_folder / "bone.stl").stat().st_size
    assert count == 84 + 50 * int.from_bytes(header, "little")
    assert json.loads((readme_folder / "out" / "summary.json").read_text(encoding="utf-8"))


def test_the_python_of_readme_runs(readme_folder, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(readme_folder)
    exec(compile(code, "README.md", "exec"), {})
    assert re.fullmatch(r"\d+ triangles in RAS\+ mm, \d+ cm2\n", capsys.readouterr().out)
