# SPDX-License-Identifier: GPL-3.0-or-later
"""Every smoothing through all that makes surfaces; nobody but its class knows which one it is."""

import ast
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from other_workers import OtherWorkers
from volumes import in_file, of_result

import ctmc_addon
from ctmc_addon.blender.figure.comparison import Comparison
from ctmc_addon.core import (
    SETTINGS,
    Budget,
    FieldCache,
    Preview,
    ReconstructionSettings,
    SettingsError,
    SurfaceRequest,
    Volume,
    cost_estimate_steps,
    finish,
    make_surfaces_steps,
    reconstruct,
    smoothing_of,
)
from ctmc_addon.core.smoothing.choices import CHOICES, is_for_gray
from ctmc_addon.core.smoothing.methods import SMOOTHINGS
from ctmc_addon.core.smoothing.prepare import field_steps
from ctmc_addon.reporting.captions import figure_caption, smoothing_phrase

PACKAGE = Path(ctmc_addon.__file__).parent
OWNERS = {"core/smoothing/choices.py"}
"""Files that may name a smoothing, beside those of `core/smoothing/methods`."""
AFFINE = np.diag([0.9, 0.9, 2.5, 1.0])
every_smoothing = pytest.mark.parametrize("name", SMOOTHINGS)


def named_smoothings(source: str) -> list[int]:
    """The lines that compare a smoothing's name, or are a string that only a smoothing has for its name."""
    lines = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and node.value in set(CHOICES) - {"none"}:
            lines.append(node.lineno)
        if isinstance(node, ast.Compare):
            asked = any("smoothing" in ast.unparse(side) for side in (node.left, *node.comparators))
            words = [each.value for each in ast.walk(node) if isinstance(each, ast.Constant)]
            if asked and any(word in (*CHOICES, "auto") for word in words):
                lines.append(node.lineno)
        if isinstance(node, ast.keyword) and node.arg == "smoothing" and isinstance(node.value, ast.Constant):
            lines.append(node.lineno)
    return lines


@pytest.mark.once
def test_no_file_but_its_own_names_a_smoothing():
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        lines = named_smoothings(path.read_text(encoding="utf-8"))
        if lines and name not in OWNERS and not name.startswith("core/smoothing/methods/"):
            found[name] = lines
    assert found == {}


def test_a_name_that_is_compared_is_found():
    assert named_smoothings('if settings.smoothing_method == "none":\n    pass') == [1]
    assert named_smoothings('keeps = method in ("auto", "constrained")') == [1]
    assert named_smoothings('bare = replace(settings, smoothing="none")') == [1]
    assert named_smoothings('if settings.simplifier == "none":\n    pass') == []


def test_every_choice_has_a_smoothing_and_settings_offer_all():
    assert list(SMOOTHINGS) == list(CHOICES)
    assert SETTINGS["smoothing"].choices == ("auto", *CHOICES)
    assert [smoothing.name for smoothing in SMOOTHINGS.values()] == list(CHOICES)


def two_labels():
    """Two halves of a body that touch, (slices, rows, columns)."""
    z, y, x = np.indices((11, 26, 30), float)
    body = ((z - 5) / 3.6) ** 2 + ((y - 12.5) / 8) ** 2 + ((x - 14.5) / 10) ** 2 < 1
    return Volume(np.where(body, 1 + (x > 13), 0).astype(np.uint8), AFFINE, kind="label")


def of(name, **settings):
    return ReconstructionSettings(**({"label": 1} | settings), smoothing=name)


@every_smoothing
def test_one_label_is_closed_and_samples_are_on_the_side_that_is_promised(name):
    volume = two_labels()
    result = reconstruct(volume, of(name))
    assert result.mesh.closed
    samples = np.count_nonzero(volume.values == 1) * 0.9 * 0.9 * 2.5
    assert result.mesh.volume == pytest.approx(samples, rel=0.15)
    assert result.wrong_side == 0 or not SMOOTHINGS[name].keeps_samples
    assert result.slice_steps == SMOOTHINGS[name].slice_steps(volume.spacing, of(name))


@every_smoothing
def test_the_surface_is_the_same_on_any_number_of_threads(name):
    results = [reconstruct(two_labels(), of(name), Budget(threads=threads)) for threads in (1, 3)]
    assert of_result(results[0]) == of_result(results[1])


@every_smoothing
@pytest.mark.parametrize("interfaces", ["shared", "separate"])
def test_several_labels_have_walls_as_the_settings_ask(name, interfaces):
    volume = two_labels()
    requests = [SurfaceRequest(of(name, label=label, interfaces=interfaces)) for label in (1, 2)]
    made = finish(make_surfaces_steps(volume, requests, all_needed=True))
    meshes = [each.result.mesh for each in made]
    assert all(mesh.closed for mesh in meshes)
    points = [{tuple(point) for point in mesh.vertices.tolist()} for mesh in meshes]
    common = points[0] & points[1]
    samples = np.count_nonzero(volume.values) * 0.9 * 0.9 * 2.5
    if interfaces == "shared":
        wall = np.array(sorted(common))
        assert len(wall) > 100
        assert sum(mesh.volume for mesh in meshes) == pytest.approx(samples, rel=0.15)
        assert np.abs(wall[:, 0] - 13.5 * 0.9).mean() < 0.9
    if SMOOTHINGS[name].keeps_samples:
        assert [each.result.wrong_side for each in made] == [0, 0]


@every_smoothing
def test_slabs_give_the_same_surface_where_it_is_made_by_slabs(name):
    volume = two_labels()
    whole = reconstruct(volume, of(name, normals="mesh"))
    parts = reconstruct(in_file(volume), of(name, normals="mesh"), Budget(slab_bytes=1))
    assert whole.mesh.vertices.tobytes() == parts.mesh.vertices.tobytes()
    assert whole.mesh.faces.tobytes() == parts.mesh.faces.tobytes()
    assert whole.wrong_side == parts.wrong_side


@every_smoothing
def test_workers_make_the_same_surface_or_are_refused_before_any_value_is_read(name):
    volume = in_file(two_labels())
    workers = OtherWorkers(volume, 2)
    if SMOOTHINGS[name].by_slabs:
        own = reconstruct(in_file(two_labels()), of(name))
        shared = reconstruct(volume, of(name), Budget(workers=workers, slab_bytes=1))
        assert own.mesh.vertices.tobytes() == shared.mesh.vertices.tobytes()
        assert own.wrong_side == shared.wrong_side
    else:
        remedy = f"choose {SMOOTHINGS[name].fallback}"
        with pytest.raises(SettingsError, match=f"^a label smoothed as {name} cannot .* several machines; {remedy}$"):
            reconstruct(volume, of(name), Budget(workers=workers))
        assert volume.reader.slices == []


def test_every_fallback_leads_to_slabs():
    for smoothing in SMOOTHINGS.values():
        assert smoothing.by_slabs == (not smoothing.fallback)
        assert smoothing.by_slabs or SMOOTHINGS[smoothing.fallback].by_slabs


@every_smoothing
def test_the_preview_encloses_about_the_same(name):
    volume = two_labels()
    shown = Preview(volume, budget=1e3).interactive(of(name))
    assert shown is not None
    result = reconstruct(volume, of(name))
    points = shown.surface.linear
    for end in (np.min, np.max):
        np.testing.assert_allclose(end(points, axis=0), end(result.mesh.vertices, axis=0), atol=1e-3)


@every_smoothing
def test_the_cost_counts_the_triangles_and_keeps_the_field_until_it_depends_on_a_setting(name):
    cache = FieldCache(two_labels())
    estimate = finish(cost_estimate_steps(cache, of(name)))
    assert estimate.faces == len(reconstruct(cache.volume, of(name)).mesh.faces)
    values = cache.field.values
    finish(cache.field_steps(of(name, alpha=0.5, keep_parts=1, reduction=0.5, normals="mesh", topology="trilinear")))
    assert cache.field.values is values
    changes = [{"close_border": True}, {"slice_steps": 2}, {"region": (0, 0, 0, 20, 20, 10)}, {"label": 2}]
    for change in changes:
        values = finish(cache.field_steps(of(name))).values
        made = finish(cache.field_steps(of(name, **change))).values is not values
        smoothing = SMOOTHINGS[name]
        own = {*smoothing.settings, *smoothing.reads, "region", "label"}
        assert made == (next(iter(change)) in own), change


def test_beside_others_only_the_note_of_smoothing_itself_leaves_out_what_a_label_encloses():
    own = finish(field_steps(two_labels(), of("constrained"))).notes
    (note,) = own
    assert note.startswith("Smoothed label: ")
    assert ", voxels " in note
    of_file = "Smoothed label, by the program that saved it"
    smoothing = SMOOTHINGS["constrained"]
    alone = "Smoothed label, every voxel on its own side, 2 steps per slice"
    assert smoothing.shared_notes((of_file, note), 2) == (of_file, alone)


@every_smoothing
def test_only_a_label_that_is_not_smoothed_has_a_note_before_its_values_are_read(name):
    smoothing = SMOOTHINGS[name]
    assert bool(smoothing.notes(of(name))) == (not smoothing.smooths)
    assert smoothing.notes(ReconstructionSettings(threshold=200)) == ()


@every_smoothing
def test_a_threshold_is_smoothed_or_refused(name):
    z, y, x = np.indices((9, 20, 20), float)
    gray = Volume((400 - (z - 4) ** 2 * 20 - (y - 9.5) ** 2 * 4 - (x - 9.5) ** 2 * 4).astype(np.int16), AFFINE)
    if CHOICES[name].for_gray:
        assert reconstruct(gray, ReconstructionSettings(threshold=200, smoothing=name)).mesh.closed
    else:
        with pytest.raises(SettingsError, match=f"^smoothing {name} is for labels; for a threshold choose"):
            ReconstructionSettings(threshold=200, smoothing=name)
        with pytest.raises(SettingsError, match=f"^smoothing {name} is for labels"):
            reconstruct(gray, ReconstructionSettings(smoothing=name))
    assert is_for_gray(of(name).at_threshold(200.0).smoothing)


@every_smoothing
def test_a_width_is_taken_or_refused(name):
    if CHOICES[name].has_width:
        assert of(name, smoothing_mm=0).smoothing_method == "none"
        assert of(name, smoothing_mm=2.5).smoothing_width_mm == 2.5
    else:
        assert of(name).smoothing_width_mm == 0
        with pytest.raises(SettingsError, match=f"and smoothing is {name}; choose one"):
            of(name, smoothing_mm=2.5)


def test_a_sheet_and_captions_tell_all_smoothings_apart():
    sheet = Comparison(smoothings=tuple(CHOICES)).variants(of("auto"))
    titles = [title for title, _ in sheet]
    assert len(set(titles)) == len(CHOICES)
    assert [smoothing_of(settings).name for _, settings in sheet] == list(CHOICES)
    for title, settings in sheet:
        assert title == smoothing_phrase(settings)
        assert title in figure_caption([settings], (), 0.5, 10)


def test_a_gaussian_needs_more_bytes_the_wider_it_is():
    spacing = (1.0, 1.0, 1.0)
    needs = [SMOOTHINGS["gaussian"].bytes(spacing, of("gaussian", smoothing_mm=mm), 2) for mm in (0.5, 1.0, 2.0)]
    assert needs == [(4, 4 * 5), (4, 4 * 9), (4, 4 * 17)]
    assert all(wider > narrower for narrower, wider in pairwise(needs))
    assert SMOOTHINGS["none"].bytes(spacing, of("none"), 2) == (2, 0)
