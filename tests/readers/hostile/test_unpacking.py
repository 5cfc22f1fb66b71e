# SPDX-License-Identifier: GPL-3.0-or-later
"""Small files that unpack to gigabytes: refused before they are unpacked."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image

from ctmc_addon.core import CtmcError, MemoryLimitError
from ctmc_addon.readers import read_volume
from ctmc_addon.readers.volumes.npy import NpyFile

resource = pytest.importorskip("resource", reason="this system does not tell the peak of memory")
GIB = 1 << 30


def deflated_zeros(size, window=zlib.MAX_WBITS):
    """`size` zeros, about a thousandth of that long."""
    piece = 1 << 24
    packer = zlib.compressobj(9, zlib.DEFLATED, window)
    head = packer.compress(bytes(100)) + packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(piece)) + packer.flush(zlib.Z_FULL_FLUSH)  # may be repeated
    return head + block * (size // piece) + packer.flush()


@pytest.fixture
def peak_growth():
    """Bytes by which the process has become larger than ever before."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    def growth():
        return 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)

    return growth


def refused(path, *words):
    with pytest.raises(CtmcError) as caught:
        read_volume(path)
    assert all(word in str(caught.value) for word in words), caught.value
    assert "\n" not in str(caught.value)


def test_a_deflated_dicom_of_2_gib_is_refused(tmp_path, save_slice, peak_growth):
    save_slice(tmp_path / "0.dcm", np.zeros((5, 7), np.uint16), syntax="1.2.840.10008.1.2.1.99")
    content = (tmp_path / "0.dcm").read_bytes()
    start = 144 + int.from_bytes(content[140:144], "little")
    (tmp_path / "0.dcm").write_bytes(content[:start] + deflated_zeros(2 * GIB, -zlib.MAX_WBITS))
    refused(tmp_path, "0.dcm", "unpacks")
    refused(tmp_path / "0.dcm", "0.dcm", "unpacks")
    assert peak_growth() < GIB // 2


@pytest.mark.parametrize("alone", [True, False])
def test_a_tiff_strip_of_2_gib_is_refused(tmp_path, peak_growth, alone):
    strip = deflated_zeros(2 * GIB)
    values = np.zeros((3, 40, 50), np.uint8)
    for number, plane in enumerate([values] if alone else values):
        path = tmp_path / f"{number}.tif"
        tifffile.imwrite(path, plane, photometric="minisblack", compression="zlib")
        with tifffile.TiffFile(path) as tiff:
            tags = tiff.pages[len(tiff.pages) // 2].tags
            places = [(tags["StripOffsets"], path.stat().st_size), (tags["StripByteCounts"], len(strip))]
        content = bytearray(path.read_bytes()) + strip
        for tag, value in places:
            content[tag.offset + 2 : tag.offset + 12] = struct.pack("<HII", 4, 1, value)
        path.write_bytes(content)
    refused(tmp_path / "0.tif" if alone else tmp_path, "0.tif", "unpacks")
    assert peak_growth() < GIB // 2


@pytest.mark.parametrize("compression", ["zlib", "lzma"])
def test_whole_compressed_strips_are_read(tmp_path, compression):
    values = np.random.default_rng(0).integers(0, 250, (3, 400, 500)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack", compression=compression)
    np.testing.assert_array_equal(read_volume(tmp_path / "a.tif").values, values)


@pytest.mark.parametrize("code", [50000, 34887, 34925, 34892, 7, 33003, 65535])
def test_a_tiff_of_any_compression_is_read_or_refused(tmp_path, code):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((3, 40, 50), np.uint8), photometric="minisblack")
    content = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        places = [page.tags["Compression"].offset for page in tiff.pages]
    for at in places:
        content[at + 8 : at + 10] = struct.pack("<H", code)
    path.write_bytes(content)
    refused(path, "a.tif")


@pytest.mark.parametrize("chunk", [b"iCCP", b"zTXt", b"iTXt"])
def test_a_png_chunk_of_1_gib_is_refused_or_passed_over(tmp_path, peak_growth, chunk):
    stream = io.BytesIO()
    Image.fromarray(np.zeros((40, 50), np.uint8)).save(stream, "PNG")
    content = stream.getvalue()
    body = b"a\0" + (b"\1\0\0\0" if chunk == b"iTXt" else b"\0") + deflated_zeros(GIB)
    piece = struct.pack(">I", len(body)) + chunk + body + struct.pack(">I", zlib.crc32(chunk + body))
    for number in range(3):
        (tmp_path / f"{number}.png").write_bytes(content[:33] + piece + content[33:])
    sentence = ""
    try:
        assert read_volume(tmp_path).values.shape == (3, 40, 50)
    except CtmcError as error:
        sentence = str(error)
    assert "\n" not in sentence
    assert peak_growth() < GIB // 2


def test_memory_that_runs_out_while_a_file_is_read_is_a_sentence(tmp_path, monkeypatch):
    np.save(tmp_path / "ct.npy", np.zeros((3, 4, 5)))

    def exhausted(*_):
        raise MemoryError
        yield

    monkeypatch.setattr(NpyFile, "read_raw_steps", exhausted)
    with pytest.raises(MemoryLimitError, match=r"ct\.npy needs more memory"):
        read_volume(tmp_path / "ct.npy")
