# SPDX-License-Identifier: GPL-3.0-or-later
"""Files made to hurt, and files that would be read as something else: each is one sentence, or a right volume."""

from __future__ import annotations

import gzip
import os
import struct
import time
import warnings
import zlib

import nibabel
import numpy as np
import pytest
import tifffile
from PIL import Image

from ctmc_addon.core import CtmcError, ReadError
from ctmc_addon.readers import open_volume, read_volume

VALUES = np.random.default_rng(0).integers(0, 250, (4, 20, 24)).astype(np.int16)  # (slices, rows, columns)
NRRD = "NRRD0004\ntype: short\ndimension: 3\nsizes: 24 20 4\nendian: little\nencoding: {}\n{}\n"


@pytest.fixture(autouse=True)
def within_10_seconds():
    start = time.monotonic()
    yield
    assert time.monotonic() - start < 10


def refused(path, *words):
    """The sentence with which a path is refused; it names every one of `words`."""
    with pytest.raises(ReadError) as caught:
        read_volume(path)
    text = str(caught.value)
    assert all(str(word) in text for word in words), text
    assert "\n" not in text
    return text


def nifti(path, **fields):
    """A NIfTI file whose header has other values in some fields."""
    image = nibabel.Nifti1Image(VALUES.T, np.eye(4))
    nibabel.save(image, path.with_suffix(".nii"))
    content = bytearray(path.with_suffix(".nii").read_bytes())
    header = np.frombuffer(content, image.header.template_dtype, 1)
    for name, value in fields.items():
        header[name] = value
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


@pytest.mark.parametrize("offset", [np.nan, np.inf, -np.inf, -1, 0, 347, 1e30])
@pytest.mark.parametrize("name", ["ct.nii", "ct.nii.gz"])
def test_nifti_values_that_begin_nowhere_are_refused(tmp_path, name, offset):
    refused(nifti(tmp_path / name, vox_offset=offset), name)


@pytest.mark.parametrize("slices", [2**62, 792633534417207300, 10**9])
def test_a_nifti_of_more_slices_than_any_memory_is_refused(tmp_path, slices):
    nibabel.save(nibabel.Nifti2Image(VALUES.T, np.eye(4)), tmp_path / "ct.nii")
    content = bytearray((tmp_path / "ct.nii").read_bytes())
    content[40:48] = slices.to_bytes(8, "little")
    (tmp_path / "ct.nii").write_bytes(content)
    with pytest.raises(CtmcError, match=r"ct\.nii"):
        read_volume(tmp_path / "ct.nii")


def test_a_nifti_header_extension_is_not_unpacked_without_end(tmp_path):
    content = bytearray(nifti(tmp_path / "ct.nii", vox_offset=1 << 30).read_bytes())
    content[348:360] = b"\x01\0\0\0" + struct.pack("<ii", (1 << 30) - 352, 6)
    (tmp_path / "big.nii.gz").write_bytes(gzip.compress(bytes(content) + bytes(1 << 24)))
    refused(tmp_path / "big.nii.gz", "big.nii.gz")


@pytest.mark.parametrize("extra", [0, 1000, 3 << 20])
def test_one_changed_bit_in_gzip_is_noticed_however_long_it_unpacks(tmp_path, extra):
    plain = nifti(tmp_path / "ct.nii").read_bytes() + bytes(extra)
    packed = bytearray(gzip.compress(plain, 0))  # stored, so that only the check sum can tell
    path = tmp_path / "packed.nii.gz"
    path.write_bytes(packed)
    np.testing.assert_array_equal(read_volume(path).values, VALUES)
    packed[1000] ^= 1
    path.write_bytes(packed)
    refused(path, "packed.nii.gz")


def test_gzip_that_unpacks_to_far_more_than_its_values_is_refused(tmp_path):
    plain = nifti(tmp_path / "ct.nii").read_bytes()
    (tmp_path / "bomb.nii.gz").write_bytes(gzip.compress(plain + bytes(1 << 27)))
    refused(tmp_path / "bomb.nii.gz", "bomb.nii.gz")


def detached(folder, data_file, encoding="raw"):
    """An `.nhdr` with this data file, beside 4 files of one slice each and one of all."""
    folder.mkdir(exist_ok=True)
    for number, plane in enumerate(VALUES):
        (folder / f"s{number}.raw").write_bytes(plane.tobytes())
    (folder / "all.raw").write_bytes(VALUES.tobytes())
    path = folder / "ct.nhdr"
    path.write_text(NRRD.format(encoding, f"data file: {data_file}"))
    return path


@pytest.mark.parametrize(
    "data_file", ["all.raw", "./all.raw", "s%d.raw 0 3 1", "s%01d.raw 0 3 1 2", "LIST\ns0.raw\ns1.raw\ns2.raw\ns3.raw"]
)
def test_nrrd_data_beside_the_header_is_read(tmp_path, data_file):
    np.testing.assert_array_equal(read_volume(detached(tmp_path / "in", data_file)).values, VALUES)


@pytest.mark.parametrize(
    "data_file",
    ["../secret.raw", "/etc/passwd", "\\\\host\\share\\x.raw", "C:\\x.raw", "c:x.raw", "a/../../secret.raw", "..", "."],
)
def test_nrrd_data_outside_the_headers_folder_is_not_opened(tmp_path, data_file):
    (tmp_path / "secret.raw").write_bytes(VALUES.tobytes())
    refused(detached(tmp_path / "in", data_file), "ct.nhdr", "folder")


@pytest.mark.parametrize(
    "data_file",
    [
        "x%d 0 1000000 1",
        "x%900000000d 1 1 1",
        "p%d.raw 0 1000000000000 1",
        "p%0999999999d.raw 1 4 1",
        "a%s%d.raw 1 4 1",
        "s%d.raw 0 3 0",
        "s%d.raw 3 0 1",
        "s%n.raw 0 3 1",
        "s%d.raw 0 2 1",
        "LIST\n" + "s0.raw\n" * 5,
    ],
)
def test_nrrd_names_of_data_files_are_bounded_by_the_slices(tmp_path, data_file):
    refused(detached(tmp_path, data_file), "ct.nhdr")


@pytest.mark.parametrize(
    ("encoding", "field"),
    [
        ("raw", "line skip: 10000000000000"),
        ("raw", "line skip: -1"),
        ("raw", "byte skip: -5"),
        ("gzip", "byte skip: -1"),
        ("raw", "byte skip: 10000000000000"),
        ("gzip", "byte skip: 10000000000000"),
    ],
)
def test_nrrd_skips_outside_the_file_are_refused(tmp_path, encoding, field):
    data = VALUES.tobytes() if encoding == "raw" else gzip.compress(VALUES.tobytes())
    (tmp_path / "ct.nrrd").write_bytes(NRRD.format(encoding, field + "\n").encode() + data)
    refused(tmp_path / "ct.nrrd", "ct.nrrd")


@pytest.mark.parametrize("number", ["70000", "-40000", "1.5", "x", "9" * 400])
def test_nrrd_numbers_in_words_outside_their_type_are_refused(tmp_path, number):
    words = [str(value) for value in VALUES.ravel()]
    words[7] = number
    (tmp_path / "ct.nrrd").write_text(NRRD.format("ascii", "") + " ".join(words))
    refused(tmp_path / "ct.nrrd", "ct.nrrd")


@pytest.mark.parametrize("value", ["9" * 5000, "9" * 19, "1.5", "-1", "x"])
@pytest.mark.parametrize("key", ["LabelValue", "Layer"])
def test_a_segments_number_that_is_none_is_refused(tmp_path, key, value):
    other = "Layer" if key == "LabelValue" else "LabelValue"
    fields = f"Segment0_{key}:={value}\nSegment0_{other}:=0\nSegment0_Name:=liver\n"
    (tmp_path / "ct.nrrd").write_bytes(NRRD.format("raw", fields).encode() + VALUES.tobytes())
    with pytest.raises(CtmcError) as caught:
        read_volume(tmp_path / "ct.nrrd")
    shown = value[:20] + "..." * (len(value) > 20)
    assert str(caught.value) == (
        f"ct.nrrd has '{shown}' as {key} of segment 0, and a whole number of 18 digits at most belongs there; "
        "export it again"
    )


def test_a_segment_without_a_value_is_passed_over(tmp_path):
    header = NRRD.format("raw", "Segment0_ID:=a\nSegment1_LabelValue:=\nSegment2_LabelValue:=3\nSegment2_Name:=liver\n")
    (tmp_path / "ct.nrrd").write_bytes(header.encode() + VALUES.tobytes())
    assert read_volume(tmp_path / "ct.nrrd").label_names == {3: "liver"}


@pytest.mark.parametrize("shape", [(-10, 10, 10), (True, 10, 10), (0, 10, 10), (10**9, 10**9, 10**9)])
def test_npy_shapes_that_no_volume_has_are_refused(tmp_path, shape):
    with (tmp_path / "ct.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<i2", "fortran_order": False, "shape": shape})
        file.write(bytes(2000))
    with pytest.raises(Exception, match=r"ct\.npy") as caught:
        read_volume(tmp_path / "ct.npy")
    assert type(caught.value).__module__ == "ctmc_addon.core.errors"


def test_a_deeply_nested_npy_header_is_refused(tmp_path):
    header = b"{'descr': '<i2', 'fortran_order': False, 'shape': " + b"(" * 4000 + b"}"
    (tmp_path / "ct.npy").write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
    refused(tmp_path / "ct.npy", "ct.npy", "numpy.save")


def pngs(folder, numbers=range(4)):
    """Numbered slices."""
    folder.mkdir(exist_ok=True)
    for number in numbers:
        Image.fromarray(VALUES[number % 4].astype(np.uint8)).save(folder / f"s{number}.png")
    return folder


def test_a_png_with_a_wrong_check_sum_is_refused(tmp_path):
    content = bytearray((pngs(tmp_path) / "s2.png").read_bytes())
    at = content.index(b"IDAT")
    length = int.from_bytes(content[at - 4 : at], "big")
    pixels = bytearray(zlib.decompress(content[at + 4 : at + 4 + length]))
    pixels[30] ^= 4
    changed = zlib.compress(bytes(pixels), 0)
    broken = content[: at - 4] + struct.pack(">I", len(changed)) + b"IDAT" + changed + content[at + 4 + length :]
    (tmp_path / "s2.png").write_bytes(broken)
    refused(tmp_path, "s2.png")


@pytest.mark.parametrize("numbers", [(0, 1, 3, 4), (0, 1, 2, 5), (10, 20, 40, 50, 60)])
def test_a_gap_between_numbered_slices_is_refused(tmp_path, numbers):
    refused(pngs(tmp_path, numbers), "missing")


@pytest.mark.parametrize("numbers", [(0, 2, 4, 6), (3, 4), (120503, 120507, 120611, 130000), (1, 5)])
def test_slices_numbered_evenly_or_by_a_clock_are_read(tmp_path, numbers):
    assert len(read_volume(pngs(tmp_path, numbers)).values) == len(numbers)


def test_a_chosen_slice_decides_the_format(tmp_path):
    for number in range(2):
        tifffile.imwrite(pngs(tmp_path) / f"t{number}.tif", VALUES[number].astype(np.uint8) // 2)
    volume = read_volume(tmp_path / "t0.tif")
    np.testing.assert_array_equal(volume.values, VALUES[:2] // 2)
    assert any("4 PNG beside the 2 TIFF" in note for note in volume.notes)


@pytest.mark.parametrize("end", ["png", "jpg", "tif", "bmp"])
def test_an_image_without_its_suffix_is_refused(tmp_path, end):
    Image.fromarray(VALUES[0].astype(np.uint8)).save(tmp_path / f"a.{end}")
    (tmp_path / f"a.{end}").rename(tmp_path / "slice")
    refused(tmp_path / "slice", "slice")
    refused(tmp_path, tmp_path.name)


def test_a_tiff_stack_without_its_suffix_is_read(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", VALUES, photometric="minisblack")
    (tmp_path / "a.tif").rename(tmp_path / "stack")
    np.testing.assert_array_equal(read_volume(tmp_path / "stack").values, VALUES)


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_a_wrong_image_suffix_is_forgiven_or_refused(tmp_path, kind):
    for number, plane in enumerate(VALUES.astype(np.uint8)):
        Image.fromarray(plane).save(tmp_path / f"{number}.{'tif' if kind == 'PNG' else 'png'}", kind)
    if kind == "TIFF":
        np.testing.assert_array_equal(read_volume(tmp_path).values, VALUES)
    else:
        refused(tmp_path, "0.tif")


def ifd_ends(content):
    """Where the offset to the next page stands, for every page of a little-endian TIFF."""
    at, ends = 4, []
    while (page := int.from_bytes(content[at : at + 4], "little")) != 0:
        at = page + 2 + 12 * int.from_bytes(content[page : page + 2], "little")
        ends.append(at)
    return ends


@pytest.mark.parametrize("next_page", [1 << 30, 8, 0])
def test_a_broken_chain_of_tiff_pages_is_refused(tmp_path, next_page):
    path = tmp_path / "ct.tif"
    tifffile.imwrite(path, VALUES, photometric="minisblack", compression="zlib")
    content = bytearray(path.read_bytes())
    at = ifd_ends(content)[1]
    content[at : at + 4] = struct.pack("<I", next_page)
    path.write_bytes(content)
    refused(path, "ct.tif")


@pytest.mark.parametrize("damage", ["chain", "strip beyond the end", "empty strip"])
def test_a_damaged_tiff_slice_is_refused_in_a_folder_as_it_is_alone(tmp_path, damage):
    for number, plane in enumerate(VALUES.astype(np.uint8)):
        tifffile.imwrite(
            tmp_path / f"{number}.tif", plane, photometric="minisblack", rowsperstrip=5, compression="zlib"
        )
    path = tmp_path / "2.tif"
    content = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        tags = tiff.pages[0].tags
        place = {"strip beyond the end": tags["StripOffsets"], "empty strip": tags["StripByteCounts"]}.get(damage)
    if place is None:
        at = ifd_ends(content)[0]
        content[at : at + 4] = struct.pack("<I", 1 << 30)
    else:
        item = place.valuebytecount // place.count
        value = (1 << 15) - 1 if damage == "strip beyond the end" else 0
        content[place.valueoffset + item : place.valueoffset + 2 * item] = value.to_bytes(item, "little")
    path.write_bytes(content)
    refused(tmp_path, "2.tif")
    for other in (0, 1, 3):
        (tmp_path / f"{other}.tif").unlink()
    refused(path, "2.tif")


@pytest.mark.parametrize("pages", [1, 4])
def test_a_palette_tiff_gives_its_grays_and_no_colors(tmp_path, pages):
    ramp = np.arange(256, dtype=np.uint16)[::-1] * 257
    for colors, readable in ((np.stack([ramp] * 3), True), (np.stack([ramp, ramp, ramp[::-1]]), False)):
        path = tmp_path / "0.tif"
        for number in range(4 // pages):
            values = VALUES.astype(np.uint8)[number : number + pages] if pages > 1 else VALUES.astype(np.uint8)[number]
            path = tmp_path / f"{number}.tif"
            tifffile.imwrite(path, values, photometric="palette", colormap=colors, compression="zlib")
        if readable:
            np.testing.assert_array_equal(read_volume(tmp_path).values, 255 - VALUES)
        else:
            refused(tmp_path, "colored")


@pytest.mark.parametrize(("kind", "count"), [(3, 2), (2, 1), (7, 3)])
def test_a_tiff_tag_of_another_type_is_no_traceback(tmp_path, kind, count):
    path = tmp_path / "ct.tif"
    tifffile.imwrite(path, VALUES, photometric="minisblack")
    content = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        at = tiff.pages[0].tags["PhotometricInterpretation"].offset
    content[at + 2 : at + 12] = struct.pack("<HIHH", kind, count, 1, 1)
    path.write_bytes(content)
    try:
        values = read_volume(path).values
    except ReadError:
        return
    np.testing.assert_array_equal(values, VALUES)


def test_a_pipe_is_refused(tmp_path):
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no named pipes")
    os.mkfifo(tmp_path / "v.nii")
    refused(tmp_path / "v.nii", "v.nii")
    refused(tmp_path, tmp_path.name)


def test_nested_folders_without_end_are_refused(tmp_path):
    folder = tmp_path
    try:
        for _ in range(1200):
            (folder / "a").mkdir()
            folder = folder / "a"
    except OSError:  # as deep as the system goes
        pass
    try:
        refused(tmp_path, tmp_path.name)
    finally:
        while folder != tmp_path:  # shutil.rmtree calls itself
            folder.rmdir()
            folder = folder.parent


@pytest.mark.parametrize("count", [20_000_000, 2_147_483_647, -1])
def test_a_number_of_frames_that_the_file_cannot_hold_is_refused(tmp_path, save_stack, save_slice, count):
    save_stack(tmp_path, range(3))
    save_slice(tmp_path / "3.dcm", np.zeros((5, 7), np.uint16), (-10, -20, 3), NumberOfFrames=count)
    refused(tmp_path, "3.dcm")
    refused(tmp_path / "3.dcm", "3.dcm")


def test_a_slice_of_0_frames_is_a_slice(tmp_path, save_stack):
    expected = save_stack(tmp_path, range(3), NumberOfFrames=0)
    np.testing.assert_array_equal(read_volume(tmp_path).values, expected)


@pytest.mark.parametrize(
    "tags",
    [
        {"PixelSpacing": ["1e300", "1e300"]},
        {"PixelSpacing": ["nan", "1"]},
        {"RescaleSlope": "nan"},
        {"RescaleSlope": "inf"},
        {"RescaleSlope": "1e308"},
        {"RescaleIntercept": "-1e300"},
    ],
)
def test_extreme_numbers_of_dicom_are_refused(tmp_path, save_stack, tags):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pydicom's, of what it is asked to write
        save_stack(tmp_path, range(3), **tags)
    refused(tmp_path)


def test_positions_without_measure_are_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(3), ImagePositionPatient=["1e308", "1e308", "1e308"])
    refused(tmp_path)


def test_slices_too_short_to_be_known_are_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(4))
    for number in range(4):
        (tmp_path / f"{number}.dcm").rename(tmp_path / f"I{number}")
    (tmp_path / "I3").write_bytes(b"")
    (tmp_path / "I2").write_bytes(bytes(100))
    with pytest.raises(CtmcError) as caught:
        read_volume(tmp_path)
    damage = "named like the slices, and something else"
    assert str(caught.value) == f"I2 is a truncated or damaged DICOM file ({damage}); copy it again"


@pytest.mark.parametrize(("photometric", "samples"), [("RGB", 3), ("YBR_FULL_422", 2)])
def test_a_color_slice_in_a_gray_series_is_said(tmp_path, save_stack, save_slice, photometric, samples):
    save_stack(tmp_path, range(3), shape=(4, 6))
    color = {"SamplesPerPixel": 3, "PhotometricInterpretation": photometric, "PlanarConfiguration": 0}
    dataset = save_slice(tmp_path / "3.dcm", np.zeros((4, 6 * samples), np.uint8), (-10, -20, 3), **color)
    dataset.Columns = 6
    dataset.save_as(tmp_path / "3.dcm")
    volume = read_volume(tmp_path)
    assert len(volume.values) == 3
    assert any("1 color image" in note for note in volume.notes)


def test_compressed_pixels_called_uncompressed_are_refused(tmp_path, save_stack):
    import pydicom

    save_stack(tmp_path, range(3), compress="1.2.840.10008.1.2.5")
    dataset = pydicom.dcmread(tmp_path / "1.dcm")
    dataset.file_meta.TransferSyntaxUID = "1.2.840.10008.1.2.1"
    content = (tmp_path / "1.dcm").read_bytes()
    wrong = content.replace(b"1.2.840.10008.1.2.5\0", b"1.2.840.10008.1.2.1\0", 1)
    assert wrong != content
    (tmp_path / "1.dcm").write_bytes(wrong)
    refused(tmp_path, "1.dcm")


def test_a_compressed_slice_that_is_cut_off_is_refused(tmp_path, save_stack):
    save_stack(tmp_path, range(3), shape=(64, 64), compress="1.2.840.10008.1.2.5")
    content = (tmp_path / "1.dcm").read_bytes()
    for share in (0.6, 0.9, 0.99):
        (tmp_path / "1.dcm").write_bytes(content[: int(share * len(content))])
        refused(tmp_path, "1.dcm")


def test_a_source_opens_without_its_values(tmp_path):
    source = open_volume(nifti(tmp_path / "ct.nii.gz"))
    assert (source.format, source.has_geometry, source.name, source.files) == (
        "NIfTI",
        True,
        "ct",
        (tmp_path / "ct.nii.gz",),
    )
    assert (source.series[0].shape, source.series[0].dtype) == (VALUES.shape, "int16")
    np.testing.assert_array_equal(source.read().values, VALUES)
