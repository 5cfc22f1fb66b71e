# SPDX-License-Identifier: GPL-3.0-or-later
"""Stacks without orientation: image folders, multi-page TIFF, NumPy files."""

from __future__ import annotations

import struct
import zlib

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile
from PIL import Image

from ctmc_addon.core import Budget, CtmcError
from ctmc_addon.readers import open_volume, read_volume

AXIAL = np.diag([-1.0, -1.0, 1.0, 1.0])


def numbers(dtype="u1", shape=(4, 6, 5)):
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype=np.dtype(dtype), endpoint=True)


def save_folder(folder, planes, end=".png", name="slice_{}"):
    folder.mkdir(parents=True, exist_ok=True)
    for number, plane in enumerate(planes, 1):
        path = folder / (name.format(number) + end)
        if end in (".tif", ".tiff"):
            tifffile.imwrite(path, plane)
        else:
            iio.imwrite(path, plane)
    return folder


def save_png(path, pixels, color_type):
    """A 16 bit PNG of any color type, which Pillow cannot write."""

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows, columns = pixels.shape[:2]
    lines = b"".join(b"\0" + row.astype(">u2").tobytes() for row in pixels)
    head = struct.pack(">IIBBBBB", columns, rows, 16, color_type, 0, 0, 0)
    parts = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + parts)


def said(volume, text):
    return any(text in note for note in volume.notes)


@pytest.mark.parametrize("end", [".png", ".bmp", ".tif", ".TIFF", ".PNG"])
def test_a_folder_of_8_bit_slices_keeps_its_values(tmp_path, end):
    array = numbers()
    folder = save_folder(tmp_path / "stack", array, end.lower())
    for path in list(folder.iterdir()):
        path.rename(path.with_suffix(end))
    volume = read_volume(folder)
    np.testing.assert_array_equal(volume.values, array)
    assert (volume.values.dtype, volume.kind, volume.name) == (np.uint8, "gray value", "stack")
    np.testing.assert_array_equal(volume.affine, AXIAL)
    assert said(
        volume, "taken as axial, columns towards the patient's left, rows towards the back, slices towards the head"
    )
    assert said(volume, "1 mm is assumed")
    assert volume.orientation == "LPS"


@pytest.mark.parametrize("end", [".png", ".tif"])
def test_16_bits_stay_16_bits(tmp_path, end):
    array = numbers("u2")
    volume = read_volume(save_folder(tmp_path, array, end))
    np.testing.assert_array_equal(volume.values, array)
    assert volume.values.dtype == np.uint16


@pytest.mark.parametrize("dtype", ["i2", "i4", "f4", ">u2"])
def test_tiff_slices_keep_their_type(tmp_path, dtype):
    array = np.random.default_rng(0).normal(0, 900, (3, 4, 5)).astype(dtype)
    for number, plane in enumerate(array):
        tifffile.imwrite(tmp_path / f"{number}.tif", plane, byteorder=">" if ">" in dtype else "<")
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, array)
    assert volume.values.dtype == np.dtype(dtype).newbyteorder("=")


def test_names_are_in_natural_order(tmp_path):
    array = np.arange(12, dtype=np.uint8)[:, None, None] * np.ones((1, 3, 4), np.uint8)
    volume = read_volume(save_folder(tmp_path, array))
    np.testing.assert_array_equal(volume.values[:, 0, 0], np.arange(12))


def test_jpeg_is_read_and_said_to_be_lossy(tmp_path):
    plane = np.tile(np.arange(0, 160, 10, dtype=np.uint8), (16, 1))
    for number in range(3):
        Image.fromarray(plane).convert("RGB" if number else "L").save(tmp_path / f"{number}.jpg", quality=95)
    volume = read_volume(tmp_path)
    assert np.abs(volume.values.astype(int) - plane).max() <= 8
    assert said(volume, "JPEG is lossy")


@pytest.mark.parametrize("channels", ["RGB", "RGBA", "LA"])
def test_color_that_is_gray_is_gray(tmp_path, channels):
    array = numbers()
    for number, plane in enumerate(array):
        Image.fromarray(plane).convert(channels).save(tmp_path / f"{number}.png")
    np.testing.assert_array_equal(read_volume(tmp_path).values, array)


@pytest.mark.parametrize(("color_type", "channels"), [(2, 3), (6, 4)])
def test_16_bit_color_is_refused_instead_of_cut_to_8_bits(tmp_path, color_type, channels):
    array = numbers("u2")
    for number, plane in enumerate(array):
        pixels = np.repeat(plane[..., None], channels, axis=2)
        pixels[..., 3:] = 65535
        save_png(tmp_path / f"{number}.png", pixels, color_type)
    with pytest.raises(CtmcError, match="16 bit color"):
        read_volume(tmp_path)


def test_16_bit_gray_with_alpha_is_refused(tmp_path):
    for number in range(2):
        save_png(tmp_path / f"{number}.png", numbers("u2", (4, 4, 2)), 4)
    with pytest.raises(CtmcError, match="16 bit color or an alpha channel"):
        read_volume(tmp_path)


@pytest.mark.parametrize("end", [".png", ".tif", ".jpg"])
def test_color_is_refused(tmp_path, end):
    color = np.zeros((3, 16, 16, 3), np.uint8)
    color[1, 4:, :, 0] = 200
    for number, picture in enumerate(color):
        if end == ".tif":
            tifffile.imwrite(tmp_path / f"{number}{end}", picture, photometric="rgb")
        else:
            Image.fromarray(picture).save(tmp_path / f"{number}{end}")
    with pytest.raises(CtmcError, match=rf"1{end} is colored .*up to 20"):
        read_volume(tmp_path)


def test_transparency_is_refused(tmp_path):
    pixels = np.full((2, 4, 4, 4), 255, np.uint8)
    pixels[1, 0, 0, 3] = 10
    for number, picture in enumerate(pixels):
        Image.fromarray(picture).save(tmp_path / f"{number}.png")
    with pytest.raises(CtmcError, match=r"1.png is partly transparent"):
        read_volume(tmp_path)


def test_one_bit_and_palette_images_become_gray(tmp_path):
    mask = numbers() > 127
    for number, plane in enumerate(mask):
        Image.fromarray(plane).save(tmp_path / f"{number}.png")
    np.testing.assert_array_equal(read_volume(tmp_path).values, mask * 255)
    for number, plane in enumerate(mask):
        picture = Image.fromarray(plane.astype(np.uint8), mode=None).convert("P")
        picture.putpalette([40, 40, 40, 90, 90, 90])
        picture.save(tmp_path / f"{number}.png")
    np.testing.assert_array_equal(read_volume(tmp_path).values, np.where(mask, 90, 40))


def test_stray_files_are_ignored_and_other_images_said(tmp_path):
    array = numbers()
    save_folder(tmp_path, array)
    save_folder(tmp_path / "thumbnails", numbers(shape=(9, 2, 2)))
    (tmp_path / "Thumbs.db").write_bytes(b"x")
    (tmp_path / ".hidden.png").write_bytes(b"x")
    Image.fromarray(array[0]).save(tmp_path / "preview.jpg")
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, array)
    assert said(volume, "1 JPEG beside the 4 PNG slices left out")


def test_one_slice_stands_for_its_folder(tmp_path):
    array = numbers()
    save_folder(tmp_path / "ct", array)
    volume = read_volume(tmp_path / "ct" / "slice_3.png")
    np.testing.assert_array_equal(volume.values, array)
    assert volume.name == "ct"
    assert said(volume, "slice_3.png is one slice: its folder was read")


@pytest.mark.parametrize("end", [".png", ".tif"])
def test_one_slice_only_is_refused(tmp_path, end):
    save_folder(tmp_path, numbers()[:1], end)
    for path in (tmp_path, tmp_path / f"slice_1{end}"):
        with pytest.raises(CtmcError, match=rf"only one slice \(slice_1{end}\).*at least 2"):
            read_volume(path)


@pytest.mark.parametrize("end", [".png", ".tif"])
def test_slices_of_different_sizes_are_refused(tmp_path, end):
    save_folder(tmp_path, [*numbers(), np.zeros((6, 9), np.uint8)], end)
    with pytest.raises(CtmcError, match=rf"slice_5{end} is 9 x 6 pixels and most are 5 x 6"):
        read_volume(tmp_path)


def test_slices_of_different_depths_are_refused(tmp_path):
    save_folder(tmp_path, [*numbers(), numbers("u2")[0]])
    with pytest.raises(CtmcError, match=r"slice_5.png is uint16 and most are uint8"):
        read_volume(tmp_path)


@pytest.mark.parametrize("end", [".png", ".jpg", ".bmp", ".tif"])
@pytest.mark.parametrize("share", [0.02, 0.6])
def test_a_truncated_slice_is_refused(tmp_path, end, share):
    save_folder(tmp_path, numbers(shape=(3, 40, 40)), end)
    path = tmp_path / f"slice_2{end}"
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(CtmcError, match=rf"slice_2{end}.*copy it again"):
        read_volume(tmp_path)


@pytest.mark.parametrize(
    "options", [{}, {"compression": "zlib"}, {"imagej": True}, {"bigtiff": True}, {"contiguous": False}]
)
@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_a_multi_page_tiff_keeps_its_values(tmp_path, options, dtype):
    array = np.random.default_rng(0).integers(0, 250, (6, 5, 7)).astype(dtype)
    path = tmp_path / "stack.tif"
    if options == {"contiguous": False}:
        with tifffile.TiffWriter(path) as writer:
            for plane in array:
                writer.write(plane, contiguous=False)
    else:
        tifffile.imwrite(path, array, **options)
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, array)
    assert volume.values.dtype == np.dtype(dtype)
    assert said(volume, "TIFF has no orientation")
    assert (open_volume(path).series[0].slices, open_volume(path).series[0].size) == (6, (7, 5))


def test_pages_that_are_gray_in_color_or_white_is_zero_are_gray(tmp_path):
    array = numbers()
    tifffile.imwrite(tmp_path / "rgb.tif", np.repeat(array[..., None], 3, axis=3), photometric="rgb")
    tifffile.imwrite(tmp_path / "white.tif", 255 - array, photometric="miniswhite")
    for name in ("rgb.tif", "white.tif"):
        np.testing.assert_array_equal(read_volume(tmp_path / name).values, array)


def test_a_compression_that_tifffile_leaves_to_another_library_is_read(tmp_path):
    array = numbers(shape=(3, 20, 20))
    pages = [Image.fromarray(plane) for plane in array]
    pages[0].save(tmp_path / "stack.tif", save_all=True, append_images=pages[1:], compression="tiff_lzw")
    np.testing.assert_array_equal(read_volume(tmp_path / "stack.tif").values, array)
    folder = tmp_path / "folder"
    folder.mkdir()
    for number, page in enumerate(pages):
        page.save(folder / f"{number}.tif", compression="tiff_lzw")
    np.testing.assert_array_equal(read_volume(folder).values, array)


@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}, {"imagej": True}])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.97])
def test_a_truncated_tiff_is_refused(tmp_path, options, share):
    path = tmp_path / "stack.tif"
    tifffile.imwrite(path, numbers(shape=(6, 30, 30)), **options)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(CtmcError, match=r"stack.tif.*copy it again"):
        read_volume(path)


def test_several_multi_page_files_in_a_folder_are_refused(tmp_path):
    for name in ("a.tif", "b.tif"):
        tifffile.imwrite(tmp_path / name, numbers(), photometric="minisblack")
    with pytest.raises(CtmcError, match=r"a.tif has 4 pages among 2 TIFF files"):
        read_volume(tmp_path)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["?", "u1", "i2", ">i2", "f4", "f8", "i8"])
def test_a_numpy_file_keeps_its_values(tmp_path, order, dtype):
    array = np.asarray(numbers() % 100, dtype=dtype, order=order)
    np.save(tmp_path / "ct.npy", array)
    volume = read_volume(tmp_path / "ct.npy", spacing=(0.5, 0.6, 2))
    np.testing.assert_array_equal(volume.values, array)
    np.testing.assert_array_equal(volume.affine, np.diag([-0.5, -0.6, 2, 1]))
    assert len(volume.notes) == 1


@pytest.mark.parametrize(
    ("array", "text"),
    [
        (np.zeros((4, 5)), r"shape \(4, 5\)"),
        (np.zeros((4, 5, 6, 2)), r"shape \(4, 5, 6, 2\)"),
        (np.zeros((4, 5, 6), complex), "complex128"),
        (np.full((2, 2, 2), "x"), "<U1"),
        (np.zeros((1, 5, 6)), "at least 2 samples"),
    ],
)
def test_a_numpy_file_that_is_no_volume_is_refused(tmp_path, array, text):
    np.save(tmp_path / "ct.npy", array)
    with pytest.raises(CtmcError, match=text):
        read_volume(tmp_path / "ct.npy")


def test_objects_in_a_numpy_file_are_never_unpickled(tmp_path):
    np.save(tmp_path / "ct.npy", np.array([[[{}]]], object), allow_pickle=True)
    with pytest.raises(CtmcError, match="object"):
        read_volume(tmp_path / "ct.npy")


@pytest.mark.parametrize("size", [3, 50, 300])
def test_a_truncated_numpy_file_is_refused(tmp_path, size):
    np.save(tmp_path / "ct.npy", numbers(shape=(4, 20, 20)))
    (tmp_path / "ct.npy").write_bytes((tmp_path / "ct.npy").read_bytes()[:size])
    with pytest.raises(CtmcError, match=r"ct.npy.*again"):
        read_volume(tmp_path / "ct.npy")


def test_a_stack_beyond_the_memory_is_refused_before_it_is_read(tmp_path, monkeypatch):
    save_folder(tmp_path, numbers())
    monkeypatch.setattr("ctmc_addon.readers.images.folder.gray_slice", lambda _: pytest.fail("a slice was read"))
    with pytest.raises(CtmcError, match=r"5 x 6 x 4.*memory"):
        read_volume(tmp_path, budget=Budget(bytes=10))
