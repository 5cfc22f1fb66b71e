# SPDX-License-Identifier: GPL-3.0-or-later
"""No output replaces a file that is read, whichever of the two is named first."""

import os
from pathlib import Path

import pytest

from ctmc_addon.core import OutputError
from ctmc_addon.core.files.atomic_write import require_writable, whole_file, whole_files, write_text
from ctmc_addon.core.files.input_files import add_inputs, own_input_files, plan_output, require_no_input


@pytest.fixture
def scan(tmp_path):
    """A file of the input, in work of its own."""
    path = tmp_path / "scan" / "s1.png"
    path.parent.mkdir()
    path.write_text("the patient")
    with own_input_files():
        yield path
    assert path.read_text() == "the patient"


def sentence(path):
    return f"{path} is a file of the input and would be replaced; choose another name or folder"


def test_nothing_is_written_over_an_input(scan):
    add_inputs([scan])
    for write in (
        lambda: write_text(scan, "a figure"),
        lambda: whole_files([scan.with_name("new.json"), scan]).__enter__(),
        lambda: require_writable(scan),
        lambda: plan_output(scan),
    ):
        with pytest.raises(OutputError) as refused:
            write()
        assert str(refused.value) == sentence(scan)
    assert [path.name for path in scan.parent.iterdir()] == ["s1.png"]


def test_an_output_that_was_planned_is_no_input(scan):
    require_writable(scan)
    with pytest.raises(OutputError) as refused:
        add_inputs([scan.with_name("s0.png"), scan])
    assert str(refused.value) == sentence(scan)


def test_a_new_file_beside_the_input_is_written(scan):
    require_writable(scan.with_name("s2.stl"))
    add_inputs([scan, scan.with_name("s2.stl")])
    write_text(scan.with_name("s2.stl"), "a surface")
    assert scan.with_name("s2.stl").read_text() == "a surface"


def test_another_spelling_is_the_same_file(scan, monkeypatch):
    monkeypatch.chdir(scan.parent)
    add_inputs(["s1.png"])
    monkeypatch.chdir(scan.parent.parent)
    spellings = [scan, "scan/s1.png", "./scan/../scan/s1.png"]
    if Path(str(scan).upper()).exists():
        spellings.append(str(scan).upper())
    for spelling in spellings:
        with pytest.raises(OutputError, match="is a file of the input"):
            require_no_input(spelling)


@pytest.mark.parametrize("linked", ["output", "input", "folder"])
@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_a_link_is_the_same_file(scan, linked):
    link = scan.parent.parent / "link.png"
    if linked == "folder":
        link.with_suffix("").symlink_to(scan.parent)
        link = link.with_suffix("") / "s1.png"
    else:
        link.symlink_to(scan)
    read, written = (link, scan) if linked == "input" else (scan, link)
    add_inputs([read])
    with pytest.raises(OutputError, match="is a file of the input"), whole_file(written):
        pass


def test_a_second_name_of_the_file_is_the_same_file(scan):
    second = scan.with_name("figure.png")
    os.link(scan, second)
    add_inputs([scan])
    with pytest.raises(OutputError, match="is a file of the input"):
        require_no_input(second)


def test_a_file_that_took_the_place_of_an_input_is_protected_too(scan):
    add_inputs([scan])
    with pytest.raises(OutputError, match="is a file of the input"):
        require_no_input(scan)
    scan.with_name("new").write_text("the patient")
    scan.with_name("new").replace(scan)
    with pytest.raises(OutputError, match="is a file of the input"):
        require_no_input(scan)


def test_the_number_of_a_removed_input_protects_no_other_file(scan):
    removed = scan.with_name("removed.png")
    removed.write_text("x")
    add_inputs([removed])
    require_no_input(scan)  # the numbers of both are known now
    os.link(removed, scan.with_name("other.png"))
    removed.unlink()
    require_no_input(scan.with_name("other.png"))


def test_the_next_work_knows_nothing_of_the_inputs_of_the_last(scan):
    with own_input_files():
        add_inputs([scan])
        require_writable(scan.with_name("a.stl"))
    require_no_input(scan)
    add_inputs([scan.with_name("a.stl")])


def test_without_a_command_a_file_may_be_written_and_read_later(tmp_path):
    path = require_writable(tmp_path / "a.npy")
    write_text(path, "values")
    add_inputs([path])
    with pytest.raises(OutputError, match="is a file of the input"):
        write_text(path, "other values")
