# SPDX-License-Identifier: GPL-3.0-or-later
"""Compressed gray frames, and DICOM files that hold them."""

from __future__ import annotations

import numpy as np
import pytest

J2K, LOSSLESS_JPEG, JPEG_LS = "1.2.840.10008.1.2.4.90", "1.2.840.10008.1.2.4.70", "1.2.840.10008.1.2.4.80"


def lossless_jpeg(pixels):
    """A 16 bit lossless JPEG (T.81 annex H): every difference to the left neighbor in a category of 16 bits."""
    rows, columns = pixels.shape
    left = np.concatenate([np.roll(pixels[:, :1], 1, 0), pixels[:, :-1]], axis=1).astype(np.int64)
    left[0, 0] = 1 << 15
    differences = ((pixels - left + (1 << 15)) % (1 << 16) - (1 << 15)).ravel()
    sizes = [int(abs(value)).bit_length() for value in differences]
    # Each of the 17 categories is a code of 5 bits.
    bits = "".join(
        f"{size:05b}" + (f"{value if value > 0 else value + (1 << size) - 1:0{size}b}" if 0 < size < 16 else "")
        for value, size in zip(differences.tolist(), sizes, strict=True)
    )
    bits += "1" * (-len(bits) % 8)
    data = int(bits, 2).to_bytes(len(bits) // 8, "big").replace(b"\xff", b"\xff\x00")
    table = b"\x00" + bytes([0, 0, 0, 0, 17, *[0] * 11]) + bytes(range(17))
    return (
        b"\xff\xd8\xff\xc3\x00\x0b\x10"
        + rows.to_bytes(2, "big")
        + columns.to_bytes(2, "big")
        + b"\x01\x01\x11\x00\xff\xc4"
        + (2 + len(table)).to_bytes(2, "big")
        + table
        + b"\xff\xda\x00\x08\x01\x01\x00\x01\x00\x00"
        + data
        + b"\xff\xd9"
    )


def jpeg_ls(pixels):
    """A JPEG-LS picture as pydicom brings one along: nothing here writes them."""
    pydicom = pytest.importorskip("pydicom")
    from pydicom.data import get_testdata_file
    from pydicom.encaps import generate_frames

    path = get_testdata_file("MR_small_jpeg_ls_lossless.dcm", download=False)
    if path is None:
        pytest.skip("this pydicom has no JPEG-LS file")
    dataset = pydicom.dcmread(path)
    return next(generate_frames(dataset.PixelData, number_of_frames=1))


def j2k(pixels):
    utils = pytest.importorskip("openjpeg.utils")
    return utils.encode_array(pixels, photometric_interpretation=2)


def compressed(path, syntax, frame, **tags):
    """Put a compressed frame into a DICOM file in place of its pixels, and change other elements."""
    import pydicom
    from pydicom.encaps import encapsulate

    dataset = pydicom.dcmread(path)
    dataset.file_meta.TransferSyntaxUID = syntax
    dataset.PixelData = encapsulate([frame])
    dataset["PixelData"].VR, dataset["PixelData"].is_undefined_length = "OB", True
    for keyword, value in tags.items():
        setattr(dataset, keyword, value)
    dataset.save_as(path)
