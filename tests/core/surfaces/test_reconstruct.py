# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole of core: space, labels, regions, softening, parts, simplification, in their order."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from meshes import component_of_face
from volumes import in_file, waves

from ctmc_addon.core import (
    Budget,
    FieldCache,
    ReconstructionSettings,
    Volume,
    cost_estimate_steps,
    finish,
    marching_cubes,
    reconstruct,
    reconstruct_steps,
    simplified_steps,
    without_small_steps,
)
from ctmc_addon.core.errors import LabelError, MemoryLimitError, MeshError, SettingsError, ThresholdError
from ctmc_addon.core.extraction import grid
from ctmc_addon.core.mesh.measures import component_volumes_steps
from ctmc_addon.core.surfaces.extract import full_steps


def ball(size=(40, 36, 30), radius=9.0, spacing=(1.0, 1.0, 1.0), where=0.5):
    """Distance to a sphere in mm, positive inside; (slices, rows, columns)."""
    x, y, z = (np.arange(n) * step for n, step in zip(size, spacing, strict=True))
    cx, cy, cz = (where * (n - 1) * step for n, step in zip(size, spacing, strict=True))
    distance = np.sqrt((z[:, None, None] - cz) ** 2 + (y[:, None] - cy) ** 2 + (x - cx) ** 2)
    return (radius - distance).astype(np.float32)


AFFINES = {
    "plain": np.diag([1.0, 1.0, 1.0, 1.0]),
    "mirrored": np.diag([-1.0, -1.0, 1.0, 1.0]) @ np.diag([1.0, 1.0, -1.0, 1.0]),
    "anisotropic": np.diag([0.7, 0.8, 2.5, 1.0]),
    "sheared": np.array([[1, 0, 0.3, 50], [0, 1, 0.4, -20], [0, 0, 1.5, 900], [0, 0, 0, 1.0]]),
    "oblique": np.array([[0, 0.6, -0.8, 3], [0, 0.8, 0.6, 2], [1.0, 0, 0, 1], [0, 0, 0, 1.0]]),
}


@pytest.mark.parametrize("name", AFFINES)
def test_positions_are_the_index_positions_carried_by_the_affine(name):
    affine = AFFINES[name]
    values = ball()
    settings = ReconstructionSettings(threshold=0.0, stride=(2, 2, 1), alpha=0.6)
    result = reconstruct(Volume(values, affine), settings)
    index = marching_cubes(values, 0.0, (2, 2, 1), 0.6)
    expected = index.vertices.astype(float) @ affine[:3, :3].T + affine[:3, 3]
    np.testing.assert_allclose(result.mesh.vertices, expected, atol=2e-4)
    determinant = np.linalg.det(affine[:3, :3])
    assert result.mesh.volume == pytest.approx(index.volume * abs(determinant), rel=1e-4)
    assert result.mesh.closed


@pytest.mark.parametrize("name", AFFINES)
def test_normals_point_outward_in_patient_space(name):
    result = reconstruct(Volume(ball(), AFFINES[name]), ReconstructionSettings(threshold=0.0))
    corners = result.mesh.vertices[result.mesh.faces].astype(float)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    against = (outward * result.mesh.normals[result.mesh.faces].mean(axis=1)).sum(axis=1)
    assert against.min() > 0.8


def test_an_ellipsoid_on_anisotropic_voxels_has_the_spheres_area_and_normals():
    spacing = (0.7, 0.8, 2.5)
    values = ball((44, 40, 16), 12.0, spacing)
    result = reconstruct(Volume(values, np.diag([*spacing, 1])), ReconstructionSettings(threshold=0.0))
    assert 0.98 * 4 * np.pi * 144 < result.mesh.area < 4 * np.pi * 144
    middle = np.array([43 * 0.7, 39 * 0.8, 15 * 2.5]) / 2
    exact = result.mesh.vertices - middle
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip((exact * result.mesh.normals).sum(axis=1), -1, 1)))
    assert angle.max() < 3


def test_a_label_at_the_border_is_closed_on_request():
    labels = np.zeros((6, 8, 9), np.uint8)
    labels[0:3, 2:6, 4:9] = 3
    volume = Volume(labels, np.eye(4), kind="label")
    closed = reconstruct(volume, ReconstructionSettings(label=3, close_border=True, smoothing="none"))
    assert closed.mesh.closed
    np.testing.assert_allclose(closed.mesh.vertices.max(axis=0), [8.5, 5.5, 2.5])
    assert not reconstruct(volume, ReconstructionSettings(label=3)).mesh.closed


@pytest.mark.parametrize("soften", [0.0, 1.0])
def test_a_region_gives_the_surface_inside_it_and_counts_its_voxels(soften):
    values = ball()
    region = (4, 5, 6, 20, 25, 22)
    whole = Volume(values, np.diag([1.0, 1.0, 2.0, 1.0]))
    settings = ReconstructionSettings(threshold=0.0, region=region, stride=(3, 1, 2), smoothing_mm=soften)
    result = reconstruct(whole, settings)
    assert result.voxels_visited == 6 * 20 * 8
    low, high = result.mesh.vertices.min(axis=0), result.mesh.vertices.max(axis=0)
    assert (low >= [4, 5, 12]).all()
    assert (high <= [20, 25, 44]).all()
    capped = reconstruct(whole, ReconstructionSettings(threshold=0.0, region=region, close_border=True))
    assert capped.mesh.closed


def test_a_region_in_mm_takes_every_voxel_it_touches():
    affine = np.diag([-0.5, 0.5, 2.0, 1.0])
    affine[:3, 3] = [30, -40, 100]
    volume = Volume(ball(), affine)
    mm = ReconstructionSettings(threshold=0.0, region=(20.1, -36.9, 108.3, 27.9, -30.0, 147.7), region_unit="mm")
    voxels = ReconstructionSettings(threshold=0.0, region=(4, 6, 4, 20, 20, 24))
    one, other = reconstruct(volume, mm), reconstruct(volume, voxels)
    assert one.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()


def test_the_largest_parts_are_kept():
    values = np.maximum(ball((50, 30, 30), 9, where=0.36), ball((50, 30, 30), 4, where=0.85))
    volume = Volume(values, np.eye(4))
    assert reconstruct(volume, ReconstructionSettings(threshold=0.0)).mesh.components == 2
    kept = reconstruct(volume, ReconstructionSettings(threshold=0.0, keep_parts=1))
    assert kept.mesh.components == 1
    assert kept.mesh.volume == pytest.approx(4 / 3 * np.pi * 9**3, rel=0.03)
    dropped = reconstruct(volume, ReconstructionSettings(threshold=0.0, min_part_mm3=1000))
    assert dropped.mesh.vertices.tobytes() == kept.mesh.vertices.tobytes()
    with pytest.raises(MeshError, match=r"volume of 1000 ml or more: the largest of 2 has 3.031 ml"):
        reconstruct(volume, ReconstructionSettings(threshold=0.0, min_part_mm3=1e6))


def test_the_builtin_simplifier_fixes_alpha_and_decimate_leaves_the_full_mesh():
    volume = Volume(ball(), np.eye(4))
    full = reconstruct(volume, ReconstructionSettings(threshold=0.0))
    simple = reconstruct(volume, ReconstructionSettings(threshold=0.0, reduction=0.9))
    assert simple.surface is None
    assert simple.full_faces == len(full.mesh.faces)
    assert abs(len(simple.mesh.faces) - 0.1 * simple.full_faces) <= 2
    assert simple.mesh.closed
    live = reconstruct(volume, ReconstructionSettings(threshold=0.0, reduction=0.9, simplifier="decimate"))
    assert live.surface is not None
    assert live.mesh.vertices.tobytes() == full.mesh.vertices.tobytes()


def test_a_number_of_triangles_that_cannot_be_reached_is_said():
    mask = np.zeros((4, 12, 12), np.uint8)
    mask[:, 3:, 3:] = 1  # the border's edges stay
    result = reconstruct(Volume(mask, np.eye(4)), ReconstructionSettings(threshold=0.5, target_faces=4))
    assert len(result.mesh.faces) > 4
    assert result.notes[-1].startswith(f"{len(result.mesh.faces)} triangles are left instead of 4")


def test_without_threshold_or_label_otsus_is_used_and_said():
    result = reconstruct(Volume(ball(), np.eye(4), notes=("1 mm was assumed.",)), ReconstructionSettings())
    assert result.notes[0] == "1 mm was assumed."
    assert "Otsu" in result.notes[1]
    assert f"{result.threshold:g}" in result.notes[1]
    labels = Volume((ball() > 0).astype(np.uint8), np.eye(4), kind="label")
    assert "give one label, several or all" in reconstruct(labels, ReconstructionSettings()).notes[0]


@pytest.mark.parametrize(
    ("kind", "settings", "error", "words"),
    [
        (
            "HU",
            {"threshold": 3000},
            ThresholdError,
            r"threshold 3000 is above the maximum \d+\.?\d* of this volume \(range",
        ),
        ("gray value", {"threshold": -3000}, ThresholdError, "threshold -3000 is not above the minimum"),
        ("label", {"label": 9}, LabelError, "label 9 is empty here; the labels are 1, 5"),
        ("label", {"label": 1, "region": (0, 0, 0, 5, 5, 5)}, LabelError, "empty in this region"),
        (
            "HU",
            {"threshold": 0, "stride": (1, 16, 1), "region": (0, 0, 0, 9, 9, 9)},
            SettingsError,
            "stride 16 along y",
        ),
        ("HU", {"threshold": 0, "region": (100, 0, 0, 200, 9, 9)}, SettingsError, "leaves fewer than 2"),
    ],
)
def test_what_gives_no_surface_is_one_sentence(kind, settings, error, words):
    values = ball()
    if kind == "label":
        values = np.where(values > 3, 5, np.where(values > 0, 1, 0)).astype(np.int16)
    with pytest.raises(error, match=words) as caught:
        reconstruct(Volume(values, np.eye(4), kind=kind), ReconstructionSettings(**settings))
    assert "\n" not in str(caught.value)


def test_eight_bit_slices_get_their_hint():
    values = (ball() > 0).astype(np.uint8) * 200
    with pytest.raises(ThresholdError, match="these look like 8 bit slices, not HU"):
        reconstruct(Volume(values, np.eye(4)), ReconstructionSettings(threshold=300))


def gray_beside_bright():
    values = np.zeros((12, 12, 12), np.int16)
    values[:, :, 2:4], values[:, :, 9] = 100, 3000
    return values


@pytest.mark.parametrize(
    ("settings", "place"),
    [
        ({"region": (0, 0, 0, 5, 11, 11)}, "the region"),
        ({"region": (0, 0, 0, 5, 11, 11), "smoothing_mm": 0.5, "threshold": 99}, "the region after smoothing"),
        ({"smoothing_mm": 3, "threshold": 2500}, "this volume after smoothing"),
    ],
)
def test_a_threshold_is_compared_with_what_is_extracted_and_no_8_bit_slices_are_blamed(settings, place):
    volume = Volume(gray_beside_bright(), np.eye(4))
    settings = ReconstructionSettings(**{"threshold": 2000, **settings})
    for refused in (reconstruct, lambda *given: finish(cost_estimate_steps(FieldCache(volume), given[1]))):
        with pytest.raises(ThresholdError, match=rf"maximum [0-9.]+ of {place} ") as caught:
            refused(volume, settings)
        assert "8 bit" not in str(caught.value)


def test_work_that_would_not_fit_is_refused_before_it_starts():
    volume = Volume(ball(), np.eye(4))
    with pytest.raises(MemoryLimitError, match=r"^a surface of 3068 triangles needs about .*0\.000954 MiB"):
        reconstruct(volume, ReconstructionSettings(threshold=0.0), Budget(bytes=1000))
    mask = Volume((volume.values > 0).astype(np.uint8), np.eye(4), kind="label")
    with pytest.raises(
        MemoryLimitError, match=r"^smoothing label 1 needs about .*; choose a region, fewer slice_steps"
    ):
        reconstruct(mask, ReconstructionSettings(label=1), Budget(bytes=1000))
    with pytest.raises(MemoryLimitError, match=r"^smoothing a label's 22 x 22 x 22 voxels in 1 steps a slice needs"):
        reconstruct(mask, ReconstructionSettings(label=1), Budget(bytes=40_000))
    with pytest.raises(MemoryLimitError, match=r"^a surface of 3068 triangles needs"):
        reconstruct(volume, ReconstructionSettings(threshold=0.0, reduction=0.5), Budget(bytes=300_000))


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_the_same_bytes_with_any_number_of_threads(threads):
    values = np.random.default_rng(0).normal(size=(40, 48, 64)).astype(np.float32)
    settings = ReconstructionSettings(threshold=0.1, smoothing_mm=1.0, stride=(2, 1, 1), alpha=0.4, reduction=0.5)
    one = reconstruct(Volume(values, np.eye(4)), settings, Budget(threads=1)).mesh
    many = reconstruct(Volume(values, np.eye(4)), settings, Budget(threads=threads)).mesh
    for name in ("vertices", "faces", "normals"):
        assert getattr(one, name).tobytes() == getattr(many, name).tobytes()


@pytest.mark.once
def test_steps_rise_to_one_and_can_be_closed_at_each():
    volume = Volume(ball((20, 18, 15), 5.0), np.eye(4))
    settings = ReconstructionSettings(threshold=0.0, smoothing_mm=1.0, keep_parts=1, reduction=0.5)
    fractions = [step.fraction for step in reconstruct_steps(volume, settings)]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    for stop in range(1, len(fractions), 3):
        steps = reconstruct_steps(volume, settings)
        for _ in range(stop):
            next(steps)
        steps.close()


def test_a_report_is_plain_and_a_result_can_be_pickled():
    import json

    settings = ReconstructionSettings(threshold=0.0)
    result = reconstruct(Volume(ball(), np.eye(4), name="case 7"), settings)
    report = json.loads(json.dumps(result.report()))
    assert report["faces"] == len(result.mesh.faces)
    assert report["voxels_visited"] == 39 * 35 * 29
    assert report["closed"] is True
    assert report["euler"] == 2
    assert report["components"] == report["parts"] == 1
    assert [stage["name"] for stage in report["stages"]] == ["Preparing values", "Extracting the surface"]
    assert pickle.loads(pickle.dumps(result)).mesh.faces.tobytes() == result.mesh.faces.tobytes()


def test_mesh_normals_are_the_meshs_own():
    result = reconstruct(Volume(ball(), np.eye(4)), ReconstructionSettings(threshold=0.0, normals="mesh"))
    assert result.surface.normals is None
    np.testing.assert_allclose(np.linalg.norm(result.mesh.normals, axis=1), 1, atol=1e-6)


def noisy(count=60):
    """A ball and single voxels of noise beside it."""
    values = ball()
    values[1:4:2, 1:35:3, 1:35:3].flat[:count] = 1.0
    return Volume(values, np.diag([1.0, 1.0, 1.5, 1.0]))


@pytest.mark.parametrize("normals", ["gradient", "mesh"])
def test_small_components_removed_afterwards_give_the_bytes_of_the_setting(normals):
    settings = ReconstructionSettings(threshold=0.0, normals=normals, alpha=0.7)
    full = finish(full_steps(noisy(), settings))
    assert full.mesh.components == 61
    removed = finish(simplified_steps(finish(without_small_steps(full, 10.0)), replace(settings, min_part_mm3=10.0)))
    expected = reconstruct(noisy(), replace(settings, min_part_mm3=10.0))
    assert removed.mesh.components == expected.mesh.components == 1
    assert removed.full_faces == expected.full_faces == len(expected.mesh.faces)
    for name in ("vertices", "faces", "normals"):
        assert getattr(removed.mesh, name).tobytes() == getattr(expected.mesh, name).tobytes()
    assert removed.surface.midpoints.tobytes() == expected.surface.midpoints.tobytes()
    assert removed.settings == expected.settings


def test_what_simplification_removes_is_counted_in_report_and_notes():
    result = reconstruct(noisy(), ReconstructionSettings(threshold=0.0, reduction=0.9))
    report = result.report()
    collapsed = report["collapsed_components"]
    assert collapsed["count"] == 61 - report["parts"] > 0
    assert report["removed_components"] == 0
    plain = reconstruct(noisy(), ReconstructionSettings(threshold=0.0))
    volumes = finish(component_volumes_steps(plain.mesh.vertices, plain.mesh.faces, component_of_face(plain.mesh)))
    small = np.sort(volumes)[:-1]
    assert 0.999 * small[: collapsed["count"]].sum() < collapsed["mm3"] < 1.001 * small[-collapsed["count"] :].sum()
    assert any(note.startswith(f"{collapsed['count']} specks removed (") for note in report["notes"])
    assert (plain.report()["collapsed_components"], plain.notes) == ({"count": 0, "mm3": 0.0}, ())


@pytest.mark.parametrize("more", [{}, {"reduction": 0.3}])
@pytest.mark.parametrize("asked", [{"keep_parts": 3}, {"min_part_mm3": 10.0}])
def test_what_the_settings_remove_is_counted_apart(asked, more):
    report = reconstruct(noisy(), ReconstructionSettings(threshold=0.0, **asked, **more)).report()
    left = asked.get("keep_parts", 1)
    assert report["removed_components"] == 61 - left
    assert report["parts"] == left - report["collapsed_components"]["count"]
    full = finish(full_steps(noisy(), ReconstructionSettings(threshold=0.0)))
    afterwards = finish(without_small_steps(full, asked.get("min_part_mm3", 0.0), asked.get("keep_parts", 0)))
    assert afterwards.removed_components == 61 - left


@pytest.mark.parametrize("whole_faces", [1 << 20, 4000])
def test_components_of_more_than_20_mm3_stay_and_a_note_says_why_the_goal_is_missed(whole_faces):
    values, middles = np.full((40, 60, 60), -1.0, np.float32), []
    for number, at in enumerate(np.ndindex(3, 4, 4)):
        z, y, x = (12 * place + 3 for place in at)
        side = 2 if number % 2 else 4  # voxels: 8 mm3 and 64 mm3
        values[z : z + side, y : y + side, x : x + side] = 1.0
        if side == 4:
            middles.append((x + 1.5, y + 1.5, z + 1.5))
    settings = ReconstructionSettings(threshold=0.0, alpha=0.5, target_faces=50)
    full = reconstruct(Volume(values, np.eye(4)), replace(settings, target_faces=None))
    volumes = finish(component_volumes_steps(full.mesh.vertices, full.mesh.faces, component_of_face(full.mesh)))
    assert ((volumes < 10).sum(), (volumes > 20).sum()) == (24, 24)
    assert 4000 < len(full.mesh.faces) < 1 << 20
    result = reconstruct(Volume(values, np.eye(4)), settings, Budget(whole_faces=whole_faces))
    report = result.report()
    corners, component = result.mesh.vertices[result.mesh.faces], component_of_face(result.mesh)
    found = np.array([corners[component == number].mean(axis=(0, 1)) for number in range(report["parts"])])
    off = np.linalg.norm(found[:, None] - np.array(middles), axis=2).min(axis=0)
    assert off.max() < 3
    # In batches a small one may stay too, whose box is judged once it has been simplified.
    assert 24 <= report["parts"] <= (24 if whole_faces > 4000 else 27)
    assert report["collapsed_components"]["count"] == 48 - report["parts"]
    small = volumes[volumes < 10]
    assert report["collapsed_components"]["mm3"] == pytest.approx((48 - report["parts"]) * small.mean(), rel=0.02)
    assert report["faces"] == report["parts"] * 4
    assert result.notes[-1] == (
        f"{report['faces']} triangles are left instead of 50: no further edge can be removed without moving a border, "
        "tearing or crossing the surface, or collapsing a component of more than 20 mm3."
    )


def test_an_open_surface_has_no_volume_and_the_report_says_so():
    half = Volume(ball()[:, :, :20], np.eye(4))
    opened = reconstruct(half, ReconstructionSettings(threshold=0.0))
    assert np.isnan(opened.mesh.volume)
    report = opened.report()
    assert report["volume_mm3"] is None
    assert any("open" in note for note in report["notes"])
    closed = reconstruct(half, ReconstructionSettings(threshold=0.0, close_border=True))
    assert closed.mesh.volume == closed.report()["volume_mm3"] > 0
    assert not any("open" in note for note in closed.report()["notes"])


@pytest.mark.once
@pytest.mark.parametrize(
    "more", [{}, {"keep_parts": 2}, {"reduction": 0.5}, {"normals": "mesh"}, {"smoothing_mm": 1.0}]
)
@pytest.mark.parametrize("source", [lambda volume: volume, in_file])
def test_no_stage_goes_back_whatever_is_asked_for(more, source, monkeypatch):
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * 21 * 70)
    settings = ReconstructionSettings(threshold=120.0, **more)
    steps = reconstruct_steps(source(Volume(waves(), np.eye(4))), settings, Budget(slab_bytes=1, whole_faces=2000))
    fractions = [step.fraction for step in steps]
    assert fractions == sorted(fractions)
    assert 0.9 < fractions[-1] <= 1
