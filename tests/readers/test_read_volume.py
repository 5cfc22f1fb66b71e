# SPDX-License-Identifier: GPL-3.0-or-later
"""The package's face: what it takes, refuses and promises for every format."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import nibabel
import numpy as np
import pytest
from PIL import Image

from ctmc_addon import readers
from ctmc_addon.core import Budget, CtmcError, Volume, finish
from ctmc_addon.core.volume.affine import determinant, transform_points
from ctmc_addon.readers import open_volume, read_volume, read_volume_steps

SIZE = (4, 5, 6)  # x, y, z
OBLIQUE = np.array([[-0.6, 0.3, 0.1, 12.5], [0.2, 0.7, -0.4, -80], [0.05, 0.4, 2.1, 301.25], [0, 0, 0, 1]])


@pytest.fixture
def oblique(tmp_path):
    values = np.random.default_rng(0).integers(-1000, 1000, SIZE).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(values, OBLIQUE), tmp_path / "ct.nii")
    return tmp_path / "ct.nii"


def corners(volume):
    high = np.array(volume.size) - 1
    return transform_points(volume.affine, np.array([high * np.array(bits) for bits in np.ndindex(2, 2, 2)]))


def test_the_signature_stays_as_outsiders_use_it():
    names = list(inspect.signature(read_volume).parameters)
    assert names[:5] == ["path", "spacing", "series", "strict", "flip"]


@pytest.mark.parametrize("axes", ["x", "y", "z", "xy", "xyz", "ZX"])
def test_a_flip_mirrors_the_axes_and_leaves_the_box_in_place(oblique, axes):
    plain, mirrored = read_volume(oblique), read_volume(oblique, flip=axes)
    np.testing.assert_array_equal(mirrored.values, plain.values)
    swapped = corners(mirrored).reshape(2, 2, 2, 3)
    for axis, letter in enumerate("xyz"):
        if letter in axes.lower():
            swapped = np.flip(swapped, axis)
    np.testing.assert_allclose(swapped.reshape(-1, 3), corners(plain), atol=1e-9)
    assert (determinant(mirrored.affine) * determinant(plain.affine) < 0) == (len(axes) % 2 == 1)
    assert any("mirrored along" in note for note in mirrored.notes)


def test_a_given_spacing_sets_the_lengths_and_keeps_directions_and_origin(oblique):
    plain, respaced = read_volume(oblique), read_volume(oblique, spacing=(0.5, 1, 3))
    assert respaced.spacing == pytest.approx((0.5, 1, 3))
    np.testing.assert_array_equal(respaced.affine[:3, 3], plain.affine[:3, 3])
    directions = plain.affine[:3, :3] / plain.spacing
    np.testing.assert_allclose(respaced.affine[:3, :3] / respaced.spacing, directions)
    assert any("0.5 x 1 x 3 mm as asked" in note for note in respaced.notes)


def test_a_given_spacing_names_the_one_it_replaces(oblique):
    own = " x ".join(f"{side:.4g}" for side in read_volume(oblique).spacing)
    assert any(f"instead of the file's own {own} mm" in note for note in read_volume(oblique, spacing=2).notes)


def test_a_series_is_refused_where_there_is_none_to_choose(oblique):
    with pytest.raises(CtmcError, match=r"ct.nii has no series to choose from; leave out the series '1.2.3'"):
        read_volume(oblique, series="1.2.3")
    assert read_volume(oblique, series="").size == SIZE


def test_threads_below_one_are_refused_in_every_format(oblique):
    with pytest.raises(CtmcError, match="threads must be 1 or more, not 0"):
        read_volume(oblique, budget=Budget(0))


@pytest.mark.parametrize(
    ("spacing", "text"),
    [
        (0, "along x must be from 1e-06 to 10000 mm, not 0"),
        ((1, 0, 1), "along y must be from 1e-06 to 10000 mm, not 0"),
        ((1, 1, -2), "along z must be from 1e-06 to 10000 mm, not -2"),
        ((1, float("nan"), 1), "along y must be from 1e-06 to 10000 mm"),
        (1e-7, "along x must be from 1e-06 to 10000 mm, not 1e-07"),
        ((1, 1, 20000), "along z must be from 1e-06 to 10000 mm, not 20000"),
        ((1, float("inf"), 1), "along y must be from 1e-06 to 10000 mm"),
        ((1, 1), "three numbers x, y, z in mm, not 2"),
        ("fine", "three numbers"),
    ],
)
def test_a_spacing_outside_its_limits_is_refused(oblique, spacing, text):
    with pytest.raises(CtmcError, match=text):
        read_volume(oblique, spacing=spacing)


@pytest.mark.parametrize("flip", ["w", "xx", "x-z"])
def test_a_flip_of_no_axis_is_refused(oblique, flip):
    with pytest.raises(CtmcError, match="axes x, y and z, each at most once"):
        read_volume(oblique, flip=flip)


@pytest.mark.parametrize("path", ["nowhere.nii", "no/where", "", "a" * 300, "nul\0l"])
def test_a_missing_path_is_refused(path):
    for look in (read_volume, open_volume):
        with pytest.raises(CtmcError):
            look(path)


def test_an_empty_folder_is_refused(tmp_path):
    for look in (read_volume, open_volume):
        with pytest.raises(CtmcError, match=r"is empty; choose the folder that holds the slices"):
            look(tmp_path)


def test_a_folder_without_slices_says_what_else_is_in_it(tmp_path, oblique):
    with pytest.raises(CtmcError, match=r"1 file, and none is.*choose 'ct.nii' in it"):
        read_volume(tmp_path)
    (tmp_path / "notes.txt").write_text("words")
    with pytest.raises(CtmcError, match=r"2 files, and none is.*choose 'ct.nii' in it"):
        read_volume(tmp_path)


@pytest.mark.parametrize("name", ["ct.nii", "ct.nii.gz", "ct.dcm", "ct.png", "ct.tif", "ct.npy", "ct.nrrd", "ct"])
def test_an_empty_file_is_said_to_be_empty(tmp_path, name):
    (tmp_path / name).touch()
    for look in (read_volume, open_volume):
        with pytest.raises(CtmcError, match=rf"{name} is empty \(0 bytes\); copy it again"):
            look(tmp_path / name)


def test_an_unknown_suffix_is_refused_with_the_known_ones(tmp_path):
    (tmp_path / "scan.xyz").write_bytes(b"what is this")
    with pytest.raises(CtmcError, match=r"unknown suffix '.xyz'.*\.png.*\.nii\.gz.*\.npy"):
        read_volume(tmp_path / "scan.xyz")
    (tmp_path / "scan").write_bytes(b"what is this")
    with pytest.raises(CtmcError, match=r"scan has no suffix and no known content; choose a folder, or a file.*\.png"):
        read_volume(tmp_path / "scan")


def test_content_tells_the_format_where_the_suffix_does_not(tmp_path, oblique, save_stack):
    (tmp_path / "scan.001").write_bytes(oblique.read_bytes())
    np.testing.assert_array_equal(read_volume(tmp_path / "scan.001").values, read_volume(oblique).values)
    hu = save_stack(tmp_path / "d", range(3))
    for file in list((tmp_path / "d").iterdir()):
        file.rename(file.with_suffix(".0000001"))
    np.testing.assert_array_equal(read_volume(tmp_path / "d" / "1.0000001").values, hu)


@pytest.mark.parametrize("name", ["Leber links", "Jörg Müßig", "肝臓 CT", "50% + [x]", "scan.v2"])
def test_any_name_of_folder_or_file_works(tmp_path, oblique, save_stack, name):
    folder = tmp_path / name
    folder.mkdir()
    moved = oblique.rename(folder / f"{name}.nii")
    assert read_volume(moved).name == name
    hu = save_stack(folder / name, range(3))
    volume = read_volume(folder / name)
    np.testing.assert_array_equal(volume.values, hu)
    assert volume.name == name
    for number in range(3):
        Image.fromarray(np.full((4, 5), number, np.uint8)).save(folder / f"{name} {number}.png")
    moved.unlink()
    assert read_volume(folder / f"{name} 1.png").values[2, 0, 0] == 2


def test_relative_paths_are_named_after_their_place(tmp_path, save_stack, monkeypatch):
    save_stack(tmp_path / "case", range(3))
    monkeypatch.chdir(tmp_path / "case")
    assert read_volume(".").name == "case"
    assert read_volume("1.dcm").name == "case"
    (tmp_path / "case" / "deep").mkdir()
    monkeypatch.chdir(tmp_path / "case" / "deep")
    assert read_volume("..").name == "case"
    with pytest.raises(CtmcError, match="folder deep is empty"):
        read_volume(".")


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 0)() == 0, reason="this user may read every file")
def test_a_file_that_may_not_be_read_is_refused(oblique):
    oblique.chmod(0)
    with pytest.raises(CtmcError, match=r"ct.nii cannot be read.*permissions"):
        read_volume(oblique)


def test_a_file_that_vanishes_while_it_is_read_is_one_sentence(tmp_path, save_stack):
    save_stack(tmp_path, range(80))
    steps = read_volume_steps(tmp_path)
    for step in steps:
        if step.message == "Decoding slices":
            break
    (tmp_path / "79.dcm").unlink()
    with pytest.raises(CtmcError, match=r"79.dcm cannot be read"):
        finish(steps)


@pytest.fixture(params=["dicom", "png", "npy", "nifti"])
def long_stack(request, tmp_path, save_stack):
    values = np.random.default_rng(0).integers(0, 200, (90, 5, 7)).astype(np.uint8)
    if request.param == "dicom":
        save_stack(tmp_path, range(90))
        return tmp_path
    if request.param == "png":
        for number, plane in enumerate(values):
            Image.fromarray(plane).save(tmp_path / f"{number}.png")
        return tmp_path
    if request.param == "npy":
        np.save(tmp_path / "ct.npy", values)
        return tmp_path / "ct.npy"
    nibabel.save(nibabel.Nifti1Image(values, OBLIQUE), tmp_path / "ct.nii.gz")
    return tmp_path / "ct.nii.gz"


def test_steps_rise_from_0_to_1_and_return_the_volume(long_stack):
    seen = []
    volume = finish(read_volume_steps(long_stack), seen.append)
    fractions = [step.fraction for step in seen]
    assert isinstance(volume, Volume)
    assert fractions == sorted(fractions)
    assert fractions[0] == 0
    assert fractions[-1] <= 1
    assert all(step.message for step in seen)


def test_no_thread_is_left_between_steps_and_closing_cancels(long_stack):
    before = set(threading.enumerate())
    for stop in (1, 2, 4, 7, 30):
        steps = read_volume_steps(long_stack, budget=Budget(3))
        for _, _ in zip(range(stop), steps, strict=False):
            assert set(threading.enumerate()) == before
        steps.close()
        assert set(threading.enumerate()) == before


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_any_number_of_threads_reads_the_same_bytes(long_stack, threads):
    one, many = read_volume(long_stack, budget=Budget(1)), read_volume(long_stack, budget=Budget(threads))
    assert one.values.tobytes() == many.values.tobytes()
    assert one.affine.tobytes() == many.affine.tobytes()
    assert one.notes == many.notes


def test_warnings_of_the_libraries_stay_inside(tmp_path, save_stack):
    save_stack(tmp_path, range(3))
    for file in tmp_path.iterdir():  # an identifier that pydicom warns of
        file.write_bytes(file.read_bytes().replace(b"1.2.3.4.5", b"1.2.3.x.5"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_volume(tmp_path)
    assert caught == []


def test_the_readers_import_neither_blender_nor_a_library_before_it_is_needed():
    code = (
        "import sys, ctmc_addon.readers\n"
        "libraries = ('bpy', 'pydicom', 'nibabel', 'nrrd', 'tifffile', 'imageio', 'PIL')\n"
        "print([name for name in libraries if name in sys.modules])"
    )
    root = Path(readers.__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=root, check=True)
    assert done.stdout.strip() == "[]"


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    (tmp_path / "ct.mgh").write_bytes(bytes(300))
    monkeypatch.setitem(sys.modules, "nibabel.freesurfer.mghformat", None)
    with pytest.raises(CtmcError, match="MGH needs the Python package nibabel, which is missing"):
        read_volume(tmp_path / "ct.mgh")
