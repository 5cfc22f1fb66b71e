# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface that is written as it comes is the file that `save` writes of it; cancelled, it leaves nothing."""

from dataclasses import astuple, replace

import numpy as np
import pytest
from volumes import AFFINE, FACTS, in_file, waves

from ctmc_addon.core import (
    Budget,
    CtmcError,
    ReconstructionSettings,
    Volume,
    Write,
    finish,
    reconstruct,
    reconstruct_labels_steps,
    reconstruct_steps,
)
from ctmc_addon.core.errors import OutputError
from ctmc_addon.core.extraction import grid

SMALL = Budget(threads=2, slab_bytes=1, whole_faces=3000)
SETTINGS = {
    "full": {},
    "alpha": {"alpha": 0.3, "close_border": True},
    "without normals": {"normals": "mesh", "stride": (2, 1, 2)},
    "kept": {"keep_parts": 2},
    "large enough": {"min_part_mm3": 20.0, "close_border": True},
    "gaussian": {"smoothing_mm": 1.1},
    "simplified": {"reduction": 0.7},
    "kept and simplified": {"keep_parts": 2, "reduction": 0.7},
    "triangles": {"target_faces": 3000, "normals": "mesh"},
}
FORMATS = ((".stl", "ras"), (".ply", "lps"), (".ply", "ras"))


@pytest.fixture(autouse=True)
def units_of_two_layers(monkeypatch):
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * 21 * 70)


def written(volume, settings, path, space="ras", budget=SMALL):
    return finish(reconstruct_steps(volume, settings, budget, Write(path, space)))


@pytest.mark.parametrize(
    ("name", "suffix", "space"),
    [(name, *FORMATS[at % 3]) for at, name in enumerate(SETTINGS)] + [("full", *each) for each in FORMATS[1:]],
)
def test_the_bytes_are_those_that_save_writes(name, suffix, space, tmp_path):
    settings = ReconstructionSettings(threshold=120.0, **SETTINGS[name])
    volume = Volume(waves((12, 21, 70)), AFFINE, ("a note",), kind="HU")
    whole = reconstruct(volume, settings, replace(SMALL, threads=1))
    whole.mesh.save(tmp_path / f"whole{suffix}", space)
    for number, source in enumerate((volume, in_file(volume))):
        path = tmp_path / f"{number}{suffix}"
        result = written(source, settings, path, space)
        assert path.read_bytes() == (tmp_path / f"whole{suffix}").read_bytes()
        assert len(result.mesh.faces) == 0
        assert result.surface is None
        assert [getattr(result, fact) for fact in FACTS] == [getattr(whole, fact) for fact in FACTS]
        np.testing.assert_equal(astuple(result.measures), astuple(whole.measures))
    assert len(list(tmp_path.iterdir())) == 3


def test_the_stages_say_how_long_writing_took(tmp_path):
    volume = in_file(Volume(waves(), AFFINE))
    for more, names in (
        ({}, ["Preparing values", "Extracting the surface", "Writing the surface"]),
        (
            {"keep_parts": 1, "reduction": 0.5},
            [
                "Preparing values",
                "Extracting the surface",
                "Selecting components",
                "Simplifying",
                "Writing the surface",
            ],
        ),
    ):
        result = written(volume, ReconstructionSettings(threshold=120.0, **more), tmp_path / "a.stl")
        assert [stage.name for stage in result.stages] == names
        assert all(stage.seconds >= 0 for stage in result.stages)


@pytest.mark.once
@pytest.mark.parametrize("name", ["full", "kept and simplified"])
@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_cancelled_at_any_step_nothing_is_left(name, suffix, tmp_path):
    settings = ReconstructionSettings(threshold=120.0, **SETTINGS[name])
    volume = in_file(Volume(waves((12, 21, 70)), AFFINE))

    def steps():
        return reconstruct_steps(volume, settings, replace(SMALL, threads=1), Write(tmp_path / f"a{suffix}"))

    fractions = [step.fraction for step in steps()]
    assert fractions == sorted(fractions)
    (tmp_path / f"a{suffix}").unlink()
    for count in range(1, len(fractions), max(1, len(fractions) // 12)):
        each = steps()
        for _ in range(count):
            next(each)
        each.close()
        assert list(tmp_path.iterdir()) == []


def test_a_refusal_leaves_nothing_and_what_was_there_stays(tmp_path):
    volume = in_file(Volume(waves(), AFFINE))
    (tmp_path / "a.stl").write_bytes(b"before")
    for settings in ({"threshold": 9000.0}, {"threshold": 120.0, "min_part_mm3": 1e9}):
        with pytest.raises(CtmcError):
            written(volume, ReconstructionSettings(**settings), tmp_path / "a.stl")
    with pytest.raises(OutputError, match=r"a\.obj is neither \.stl nor \.ply"):
        written(volume, ReconstructionSettings(threshold=120.0), tmp_path / "a.obj")
    assert [path.name for path in tmp_path.iterdir()] == ["a.stl"]
    assert (tmp_path / "a.stl").read_bytes() == b"before"


def test_every_label_goes_into_a_file_of_its_own(tmp_path):
    volume = Volume(np.digitize(waves(), [120, 300]).astype(np.uint8), AFFINE, kind="label")
    settings = ReconstructionSettings(smoothing="gaussian", smoothing_mm=0.8, interfaces="separate")
    steps = reconstruct_labels_steps(
        in_file(volume), settings, None, SMALL, lambda label: Write(tmp_path / f"{label}.ply")
    )
    surfaces = finish(steps).surfaces
    assert [result.settings.label for result in surfaces] == [1, 2]
    for label in (1, 2):
        reconstruct(volume, replace(settings, label=label)).mesh.save(tmp_path / "whole.ply")
        assert (tmp_path / f"{label}.ply").read_bytes() == (tmp_path / "whole.ply").read_bytes()
