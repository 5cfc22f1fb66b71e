# SPDX-License-Identifier: GPL-3.0-or-later
"""NRRD against pynrrd's own values, and space directions against closed forms."""

from __future__ import annotations

import gzip
import warnings

import nrrd
import numpy as np
import pytest
from volumes import label_mask

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume

DIRECTIONS = np.array([[0.7, 0.1, 0], [-0.1, 0.7, 0.2], [0, -0.3, 2.5]])
ORIGIN = np.array([-100.5, 20.25, 3])
LPS = {"space": "left-posterior-superior", "space directions": DIRECTIONS, "space origin": ORIGIN}


def numbers(dtype="i2", shape=(5, 6, 7)):
    return np.random.default_rng(0).integers(0 if "u" in dtype else -120, 120, shape).astype(dtype)


def saved(path, values, header=LPS, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pynrrd's own, with the newest NumPy
        nrrd.write(str(path), values, {**header}, **options)
    return path


def pynrrds(path):
    """Values as pynrrd reads them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return nrrd.read(str(path))[0]


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ASCII"])
@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", ">i2", ">f4"])
def test_values_and_type_are_pynrrds(tmp_path, encoding, dtype):
    path = saved(tmp_path / "ct.nrrd", numbers(dtype), {**LPS, "encoding": encoding})
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values.T, pynrrds(path))
    assert volume.values.dtype == np.dtype(dtype).newbyteorder("=")


SIGNS = {
    "left-posterior-superior": (-1, -1, 1),
    "LPS": (-1, -1, 1),
    "right-anterior-superior": (1, 1, 1),
    "RAS": (1, 1, 1),
    "left-anterior-superior": (-1, 1, 1),
    "left-posterior-superior-time": (-1, -1, 1),
}


@pytest.mark.parametrize("space", [name for name in SIGNS if "time" not in name])
def test_every_named_space_is_turned_to_ras(tmp_path, space):
    volume = read_volume(saved(tmp_path / "ct.nrrd", numbers(), {**LPS, "space": space}))
    index = np.array([3, 2, 6])
    expected = (ORIGIN + index @ DIRECTIONS) * SIGNS[space]
    np.testing.assert_allclose((volume.affine @ (*index, 1))[:3], expected, atol=1e-9)
    assert volume.notes == ()


def test_an_unnamed_space_is_taken_as_ras_and_said(tmp_path):
    volume = read_volume(saved(tmp_path / "ct.nrrd", numbers(), {**LPS, "space": "scanner-xyz"}))
    np.testing.assert_allclose(volume.affine[:3, :3], DIRECTIONS.T)
    assert "'scanner-xyz' does not name sides of the patient" in volume.notes[0]


def test_spacings_without_directions_are_axial_and_said(tmp_path):
    volume = read_volume(saved(tmp_path / "ct.nrrd", numbers(), {"spacings": [0.5, 0.6, 2]}))
    np.testing.assert_array_equal(volume.affine, np.diag([-0.5, -0.6, 2, 1]))
    assert "no orientation: taken as axial" in volume.notes[0]


def test_neither_spacing_nor_orientation_is_said(tmp_path):
    volume = read_volume(saved(tmp_path / "ct.nrrd", numbers(), {}))
    np.testing.assert_array_equal(volume.affine, np.diag([-1, -1, 1, 1]))
    assert "1 mm is assumed" in volume.notes[1]


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
def test_detached_data_is_found_beside_its_header(tmp_path, encoding):
    folder = tmp_path / "Leber ä 肝"
    folder.mkdir()
    array = numbers()
    saved(folder / "ct.nhdr", array, {**LPS, "encoding": encoding}, detached_header=True)
    np.testing.assert_array_equal(read_volume(folder / "ct.nhdr").values.T, array)


HEADER = "NRRD0005\ntype: short\ndimension: 3\nsizes: 5 6 8\nspacings: 1 1 2\nendian: little\nencoding: {}\n{}\n"


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize(
    "files", ["data file: part.%02d 1 4 1", "data file: part.%02d 4 1 -1", "datafile: LIST\npart.02\npart.01"]
)
def test_data_in_many_files_is_joined_in_order(tmp_path, encoding, files):
    array = numbers(shape=(8, 6, 5)).astype("<i2")
    order = [1, 2, 3, 4] if "1 4" in files else [4, 3, 2, 1] if "4 1" in files else [2, 1]
    for number, part in zip(order, np.split(array, len(order)), strict=True):
        content = part.tobytes()
        (tmp_path / f"part.{number:02}").write_bytes(gzip.compress(content) if encoding == "gzip" else content)
    (tmp_path / "ct.nhdr").write_text(HEADER.format(encoding, files))
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.nhdr").values, array)


@pytest.mark.parametrize("skip", [0, 11, -1])
def test_bytes_before_the_data_are_skipped(tmp_path, skip):
    array = numbers(shape=(8, 6, 5)).astype("<i2")
    (tmp_path / "ct.raw").write_bytes(bytes(11 if skip else 0) + array.tobytes())
    (tmp_path / "ct.nhdr").write_text(HEADER.format("raw", f"byte skip: {skip}\ndata file: ct.raw"))
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.nhdr").values, array)


@pytest.mark.parametrize("skip", ["byte skip", "line skip"])
def test_a_skip_that_no_file_is_long_enough_for_is_refused_in_a_short_sentence(tmp_path, skip):
    (tmp_path / "ct.raw").write_bytes(bytes(480))
    (tmp_path / "ct.nhdr").write_text(HEADER.format("raw", f"{skip}: {'9' * 400}\ndata file: ct.raw"))
    with pytest.raises(CtmcError, match=r"ct.raw would have to be read from behind byte 4611686018427387904 on"):
        read_volume(tmp_path / "ct.nhdr")


def test_a_missing_data_file_is_named(tmp_path):
    (tmp_path / "ct.nhdr").write_text(HEADER.format("raw", "data file: gone.raw"))
    with pytest.raises(CtmcError, match=r"ct.nhdr names the data file gone.raw, which is missing"):
        read_volume(tmp_path / "ct.nhdr")


def test_slicer_segments_name_the_labels(tmp_path):
    header = {**LPS, "Segment0_LabelValue": "1", "Segment0_Name": "Liver", "Segment1_LabelValue": "2"}
    volume = read_volume(saved(tmp_path / "x.seg.nrrd", numbers() % 3, header))
    assert volume.label_names == {1: "Liver", 2: "Segment 1"}
    assert volume.kind == "label"


@pytest.mark.parametrize(
    ("name", "encoding"),
    [("Müller Leber", "utf-8"), ("名前", "utf-8"), ("Müller Leber", "latin-1"), ("x" * 150, "ascii")],
)
def test_a_segment_keeps_the_letters_of_its_name(tmp_path, name, encoding):
    header = HEADER.format("raw", f"data file: ct.raw\nSegment0_LabelValue:=1\nSegment0_Name:={name}")
    (tmp_path / "ct.raw").write_bytes((numbers(shape=(8, 6, 5)) % 2).astype("<i2").tobytes())
    (tmp_path / "x.seg.nhdr").write_bytes(header.encode(encoding))
    assert read_volume(tmp_path / "x.seg.nhdr").label_names == {1: name}


@pytest.mark.parametrize("unit", ["um", "\u00b5m", "\u03bcm"])
def test_micrometers_become_millimeters(tmp_path, unit):
    space = "space: RAS\nspace directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (0,0,0)\ndata file: ct.raw\n"
    header = HEADER.replace("spacings: 1 1 2\n", "").format("raw", f'{space}space units: "{unit}" "{unit}" "{unit}"')
    (tmp_path / "ct.raw").write_bytes(numbers(shape=(8, 6, 5)).astype("<i2").tobytes())
    (tmp_path / "ct.nhdr").write_text(header, encoding="utf-8")
    np.testing.assert_allclose(read_volume(tmp_path / "ct.nhdr").spacing, (0.001, 0.001, 0.002))


def test_one_layer_of_a_list_is_a_volume(tmp_path):
    array = numbers(shape=(1, 5, 6, 7))
    directions = np.vstack([np.full(3, np.nan), DIRECTIONS])
    header = {**LPS, "space directions": directions, "kinds": ["list", "domain", "domain", "domain"]}
    volume = read_volume(saved(tmp_path / "x.nrrd", array, header))
    np.testing.assert_array_equal(volume.values.T, array[0])
    np.testing.assert_allclose(volume.affine[:3, 0], DIRECTIONS[0] * (-1, -1, 1))


FIRST = (np.vstack([np.full(3, np.nan), DIRECTIONS]), ["list", "domain", "domain", "domain"])
LAST = (np.vstack([DIRECTIONS, np.full(3, np.nan)]), ["domain", "domain", "domain", "time"])


@pytest.mark.parametrize("encoding", ["raw", "gzip", "ASCII"])
@pytest.mark.parametrize("axes", [FIRST, LAST])
def test_each_time_of_four_dimensions_is_read(tmp_path, axes, encoding):
    first = axes is FIRST
    array = numbers(shape=(3, 5, 6, 7) if first else (5, 6, 7, 3))
    header = {**LPS, "space directions": axes[0], "kinds": axes[1], "encoding": encoding}
    path = saved(tmp_path / "x.nrrd", array, header)
    assert open_volume(path).series[0].times == 3
    for time in (1, 2, 3):
        expected = array[time - 1] if first else array[..., time - 1]
        volume = read_volume(path, time=time)
        np.testing.assert_array_equal(volume.values.T, expected)
        np.testing.assert_allclose(volume.affine[:3, 0], DIRECTIONS[0] * (-1, -1, 1))
        part = read_volume(path, time=time, region=(1, 2, 0, 3, 5, 4), stride=(2, 1, 2))
        np.testing.assert_array_equal(part.values.T, expected[1:4:2, 2:6, 0:5:2])


def layered(path, values):
    """Two layers with three segments, of which the third overlaps the first by 2 voxels."""
    array = np.zeros((2, 5, 6, 7), np.uint8)
    array[0, :2], array[0, 3], array[1, 1, 0, :2], array[1, 4] = values[0], values[1], values[2], values[2]
    segments = {}
    for number, (layer, color) in enumerate([(0, "1 0 0"), (0, "0 1 0"), (1, "0 0 0.5")]):
        fields = {"LabelValue": values[number], "Layer": layer, "Name": f"part {number}", "Color": color}
        segments |= {f"Segment{number}_{key}": str(value) for key, value in fields.items()}
    return saved(path, array, {**LPS, "space directions": FIRST[0], "kinds": FIRST[1], **segments})


@pytest.mark.parametrize("values", [(1, 2, 3), (1, 2, 1), (7, 5, 2)])
def test_segments_in_layers_are_whole(tmp_path, values):
    volume = read_volume(layered(tmp_path / "x.seg.nrrd", values))
    labels = (1, 2, 3) if values == (1, 2, 1) else values
    expected = np.zeros((3, 5, 6, 7), bool)
    expected[0, :2], expected[1, 3], expected[2, 1, 0, :2], expected[2, 4] = True, True, True, True
    for label, mask in zip(labels, expected, strict=True):
        np.testing.assert_array_equal(label_mask(volume, label).T, mask)
    assert volume.label_names == {label: f"part {number}" for number, label in enumerate(labels)}
    colors = [(255, 0, 0), (0, 255, 0), (0, 0, 128)]
    assert volume.label_colors == dict(zip(labels, colors, strict=True))
    assert any(
        "they share part 0 and part 2 2 voxels" in note or "part 2 and part 0 2 voxels" in note for note in volume.notes
    )
    assert any("renumbered" in note for note in volume.notes) == (values == (1, 2, 1))
    assert volume.kind == "label"
    assert open_volume(tmp_path / "x.seg.nrrd").series[0].times == 1


@pytest.mark.parametrize("space", ["", "left-posterior-superior-time", "right-anterior-superior-time"])
def test_times_in_a_space_of_four_dimensions_are_read(tmp_path, space):
    """As ITK writes four dimensions: without a name of the space, in its own axes."""
    array = numbers(shape=(5, 6, 7, 3))
    directions = np.eye(4)
    directions[:3, :3] = DIRECTIONS
    header = {"space directions": directions, "space origin": [*ORIGIN, 0], "kinds": ["domain"] * 4}
    volume = read_volume(saved(tmp_path / "x.nrrd", array, header | ({"space": space} if space else {})), time=2)
    np.testing.assert_array_equal(volume.values.T, array[..., 1])
    signs = (1, 1, 1) if "right" in space else (-1, -1, 1)
    np.testing.assert_allclose(volume.affine[:3], np.column_stack([DIRECTIONS.T, ORIGIN]) * np.array(signs)[:, None])
    assert any("as ITK writes times" in note for note in volume.notes) == (not space)


def test_small_segments_in_layers_keep_all_their_voxels(tmp_path):
    array = np.zeros((2, 9, 8, 7), np.uint8)
    array[0, 5:8, 3:6, 2:5], array[1, 6, 4:7, 1:3] = 1, 1
    segments = {f"Segment{layer}_{key}": str(layer + at) for layer in (0, 1) for key, at in (("Layer", 0), ("Name", 5))}
    segments |= {f"Segment{layer}_LabelValue": "1" for layer in (0, 1)}
    header = {**LPS, "space directions": FIRST[0], "kinds": FIRST[1], **segments}
    volume = read_volume(saved(tmp_path / "x.seg.nrrd", array, header))
    np.testing.assert_array_equal(label_mask(volume, 1).T, array[0])
    np.testing.assert_array_equal(label_mask(volume, 2).T, array[1])


def test_masks_of_an_older_slicer_are_segments_by_their_number(tmp_path):
    array = np.zeros((3, 9, 8, 7), np.uint8)
    array[0, 1:5, 1:5, 1:5], array[1, 4:7, 4:7, 4:7], array[2, 8, 7, 6] = 1, 1, 1
    segments = {f"Segment{n}_{key}": f"{word} {n}" for n in range(3) for key, word in (("ID", "S"), ("Name", "part"))}
    path = saved(tmp_path / "x.seg.nrrd", array, {**LPS, "space directions": FIRST[0], "kinds": FIRST[1], **segments})
    volume = read_volume(path)
    for number in range(3):
        np.testing.assert_array_equal(label_mask(volume, number + 1).T, array[number])
    assert volume.label_names == {1: "part 0", 2: "part 1", 3: "part 2"}
    alone = {"Segment0_ID": "S 0", "Segment0_Name": "part 0"}
    volume = read_volume(saved(tmp_path / "y.seg.nrrd", array[0], {**LPS, **alone}))
    assert volume.label_names == {1: "part 0"}


def test_a_fourth_dimension_of_vectors_is_refused(tmp_path):
    header = {**LPS, "space directions": FIRST[0], "kinds": ["vector", "domain", "domain", "domain"]}
    with pytest.raises(CtmcError, match=r"sizes \(2, 5, 6, 7\) \(vector domain.*one channel as a file of its own"):
        read_volume(saved(tmp_path / "x.nrrd", numbers(shape=(2, 5, 6, 7)), header))


def test_color_is_refused(tmp_path):
    with pytest.raises(CtmcError, match="RGB-color voxels; convert"):
        read_volume(saved(tmp_path / "x.nrrd", numbers("u1", (3, 5, 6)), {"kinds": ["RGB-color", "domain", "domain"]}))


def test_singular_directions_are_refused(tmp_path):
    directions = DIRECTIONS.copy()
    directions[2] = directions[1]
    with pytest.raises(CtmcError, match="affine is singular"):
        read_volume(saved(tmp_path / "x.nrrd", numbers(), {**LPS, "space directions": directions}))


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ASCII"])
@pytest.mark.parametrize("cut", [10, 200])
def test_truncated_data_is_refused(tmp_path, encoding, cut):
    path = saved(tmp_path / "ct.nrrd", numbers(), {**LPS, "encoding": encoding})
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(CtmcError, match=r"ct.nrrd is truncated.*copy it again"):
        read_volume(path)


def test_noise_with_an_nrrd_name_is_refused(tmp_path):
    for name, content in (("a.nrrd", np.random.default_rng(0).bytes(999)), ("b.nhdr", b""), ("c.nrrd", b"NRRD0004\nx")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CtmcError, match=rf"{name}.*again"):
            read_volume(tmp_path / name)


def test_the_series_of_a_file_is_its_size(tmp_path):
    (one,) = open_volume(saved(tmp_path / "ct.nrrd", numbers())).series
    assert (one.slices, one.size) == (7, (5, 6))


@pytest.mark.parametrize("chunk", [1, 2, 7, 1000])
def test_numbers_in_words_are_the_same_however_they_are_cut(tmp_path, monkeypatch, chunk):
    monkeypatch.setattr("ctmc_addon.readers.volumes.nrrd.WORDS_CHUNK", chunk)
    path = saved(tmp_path / "ct.nrrd", numbers(), {**LPS, "encoding": "ASCII"})
    np.testing.assert_array_equal(read_volume(path).values, numbers().transpose(2, 1, 0))


def test_more_numbers_than_the_sizes_say_are_refused(tmp_path):
    path = saved(tmp_path / "ct.nrrd", numbers(), {**LPS, "encoding": "ASCII"})
    path.write_bytes(path.read_bytes() + b"17 18\n")
    with pytest.raises(CtmcError, match=r"ct.nrrd holds more than the \d+ values of its sizes"):
        read_volume(path)


def test_text_that_does_not_fit_is_refused_with_what_helps(tmp_path, monkeypatch):
    path = tmp_path / "a.nrrd"
    path.write_text("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 20 10 9\nencoding: ascii\n\n" + "1 " * 1800)
    monkeypatch.setattr("ctmc_addon.core.machine.memory.available_bytes", lambda: 1024)
    with pytest.raises(CtmcError, match=r"a.nrrd \(20 x 10 x 9\) needs .* save it compressed or raw"):
        read_volume(path, stride=(4, 4, 4))
