# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests of all kinds at once: each gives the bytes it has alone or with the labels it touches, in their order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import (
    AbsentLabelError,
    Budget,
    MadeSurface,
    ReconstructionSettings,
    SurfaceRequest,
    ThresholdError,
    Volume,
    Write,
    finish,
    make_surfaces_steps,
    one_of_labels_steps,
    reconstruct,
    reconstruct_labels,
    share_walls,
)
from ctmc_addon.core.smoothing import prepare
from ctmc_addon.core.surfaces import request as request_module

AFFINE = np.diag([1.0, 1.0, 2.0, 1.0])
ONE = Budget(threads=1)


def labels():
    """Return two halves of a ball, labels 1 and 2, and a box apart from them, label 5."""
    z, y, x = np.indices((14, 26, 34), np.float32)
    values = np.where((2 * (z - 6.5)) ** 2 + (y - 12.5) ** 2 + (x - 12.5) ** 2 < 100, 1 + (x > 12), 0)
    values[4:10, 8:18, 26:32] = 5
    return Volume(values.astype(np.uint8), AFFINE, kind="label")


def gray():
    """Return a ramp around a point."""
    z, y, x = np.indices((14, 26, 34), np.float32)
    return Volume(100 - np.sqrt((2 * (z - 6.5)) ** 2 + (y - 12.5) ** 2 + (x - 14.5) ** 2), AFFINE)


def of_label(label, **more):
    return SurfaceRequest(ReconstructionSettings(label=label), **more)


def arrays(result):
    return [part.tobytes() for part in (result.mesh.vertices, result.mesh.faces, result.mesh.normals)]


def made(volume, requests, **more):
    return finish(make_surfaces_steps(volume, requests, ONE, **more))


def test_thresholds_and_labels_of_two_volumes_come_in_the_order_of_their_requests():
    threshold = ReconstructionSettings(threshold=92.0)
    requests = [of_label(2), SurfaceRequest(threshold), of_label(1)]
    second, ball, first = made(gray(), requests, labels=labels())
    together = reconstruct_labels(labels(), ReconstructionSettings(), [1, 2], ONE).surfaces
    assert [arrays(one.result) for one in (first, second)] == [arrays(result) for result in together]
    assert arrays(ball.result) == arrays(reconstruct(gray(), threshold, ONE))
    assert [one.full for one in (first, second, ball)] == [None, None, None]


@pytest.mark.parametrize("interfaces", ["shared", "separate"])
def test_an_error_stands_in_the_place_of_its_surface_and_changes_no_other(interfaces):
    settings = ReconstructionSettings(interfaces=interfaces)
    first, absent, second = made(labels(), [SurfaceRequest(replace(settings, label=label)) for label in (1, 9, 2)])
    expected = reconstruct_labels(labels(), settings, [1, 2], ONE).surfaces
    assert [arrays(first.result), arrays(second.result)] == [arrays(result) for result in expected]
    assert isinstance(absent, AbsentLabelError)
    assert str(absent) == "label 9 is empty here; the labels are 1, 2, 5"
    with pytest.raises(AbsentLabelError, match="label 9 is empty here"):
        made(labels(), [of_label(1), of_label(9)], all_needed=True)


def test_the_only_label_that_is_there_is_made_as_if_alone(tmp_path):
    path = tmp_path / "five.stl"
    absent, only = made(labels(), [of_label(9), of_label(5, sink=Write(path))])
    alone = reconstruct(labels(), ReconstructionSettings(label=5), ONE)
    assert isinstance(absent, AbsentLabelError)
    assert only.result.measured.faces == len(alone.mesh.faces)
    alone.mesh.save(tmp_path / "alone.stl")
    assert path.read_bytes() == (tmp_path / "alone.stl").read_bytes()


def test_a_surface_of_shared_walls_is_written_with_the_bytes_it_has_when_held(tmp_path):
    held = made(labels(), [of_label(1), of_label(2)])
    written = made(labels(), [of_label(1, sink=Write(tmp_path / "1.stl")), of_label(2)])
    held[0].result.mesh.save(tmp_path / "held.stl")
    assert (tmp_path / "1.stl").read_bytes() == (tmp_path / "held.stl").read_bytes()
    assert len(written[0].result.mesh.faces) == 0
    assert written[0].result.measured.volume == held[0].result.mesh.volume
    assert arrays(written[1].result) == arrays(held[1].result)


def test_only_labels_with_the_same_settings_share_walls():
    smooth, rough = (ReconstructionSettings(label=2, alpha=alpha) for alpha in (1.0, 0.5))
    assert share_walls([replace(smooth, label=1), smooth])
    assert not share_walls([smooth])
    assert not share_walls([replace(smooth, label=1, interfaces="separate"), smooth])
    first, second = made(labels(), [SurfaceRequest(replace(smooth, label=1)), SurfaceRequest(rough)])
    assert (first.result.neighbors, second.result.neighbors) == ((), ())
    assert arrays(second.result) == arrays(reconstruct(labels(), rough, ONE))


@pytest.mark.parametrize("label", [None, 1])
def test_a_full_surface_is_simplified_again_to_the_bytes_of_its_settings(label):
    chosen = {"threshold": 92.0} if label is None else {"label": label}
    settings = ReconstructionSettings(**chosen)
    volume = gray() if label is None else labels()
    [(result, full)] = made(volume, [SurfaceRequest(settings, needs_full=True)])
    assert result.mesh.faces.tobytes() == full.mesh.faces.tobytes()
    goal = replace(settings, reduction=0.7)
    [(simplified, _)] = made(None, [SurfaceRequest(goal, full=full)])
    assert arrays(simplified) == arrays(reconstruct(volume, goal, ONE))


def test_alpha_auto_keeps_the_alpha_of_the_full_surface():
    settings = ReconstructionSettings(threshold=92.0, alpha=0.3)
    [(_, full)] = made(gray(), [SurfaceRequest(settings, needs_full=True)])
    [(simplified, kept)] = made(None, [SurfaceRequest(replace(settings, alpha="auto", reduction=0.5), full=full)])
    assert simplified.settings.alpha == 0.3
    assert kept is full


def test_labels_of_shared_walls_bring_their_full_surfaces_where_these_are_needed():
    settings = ReconstructionSettings(reduction=0.5)
    requests = [SurfaceRequest(replace(settings, label=label), needs_full=label == 2) for label in (1, 2)]
    first, second = made(labels(), requests)
    assert first.full is None
    assert len(second.full.mesh.faces) == second.result.full_faces > len(second.result.mesh.faces)


def test_a_threshold_without_a_surface_is_an_error_among_results():
    requests = [SurfaceRequest(ReconstructionSettings(threshold=threshold)) for threshold in (1e6, 92.0)]
    error, ball = made(gray(), requests)
    assert isinstance(error, ThresholdError)
    assert isinstance(ball, MadeSurface)
    assert error.__traceback__ is None


@pytest.mark.parametrize("interfaces", ["shared", "separate"])
def test_the_region_of_several_labels_is_worked_out_once(monkeypatch, interfaces):
    seen, region_box = [], request_module.region_box
    for module in (request_module, prepare):
        monkeypatch.setattr(module, "region_box", lambda *args: seen.append(args) or region_box(*args))
    settings = ReconstructionSettings(interfaces=interfaces)
    made(labels(), [SurfaceRequest(replace(settings, label=label)) for label in (1, 2, 5)])
    assert len(seen) == 1


def test_a_label_made_again_by_itself_is_the_one_that_was_made_with_its_neighbors():
    runs = [ReconstructionSettings(label=label, reduction=0.5) for label in (1, 2, 5)]
    made = [each.result for each in finish(make_surfaces_steps(labels(), [SurfaceRequest(run) for run in runs], ONE))]
    assert {each.sharing_labels for each in made} == {(1, 2, 5)}
    again = finish(one_of_labels_steps(labels(), runs[1], made[0].sharing_labels, ONE))
    assert again.mesh.vertices.tobytes() == made[1].mesh.vertices.tobytes()
    assert again.mesh.faces.tobytes() == made[1].mesh.faces.tobytes()
    alone = finish(one_of_labels_steps(labels(), runs[1], (1, 5), ONE))
    assert alone.sharing_labels == ()
    assert alone.mesh.vertices.tobytes() == reconstruct(labels(), runs[1], ONE).mesh.vertices.tobytes()
    with pytest.raises(AbsentLabelError):
        finish(one_of_labels_steps(labels(), replace(runs[0], label=3), (1, 3, 5), ONE))
