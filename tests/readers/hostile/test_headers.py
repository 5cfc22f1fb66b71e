# SPDX-License-Identifier: GPL-3.0-or-later
"""Headers that say anything at all: a volume, or one sentence. Hypothesis finds the same examples every time."""

from __future__ import annotations

import io
import struct
import warnings
import zlib

import nibabel
import numpy as np
import pytest
import tifffile
from PIL import Image

from ctmc_addon.core import CtmcError, Volume
from ctmc_addon.readers import read_volume
from ctmc_addon.readers.dicom.pixels.codestream import frame_damage

hypothesis = pytest.importorskip("hypothesis", reason="the Python package hypothesis is not installed")
from hypothesis import HealthCheck, given, settings, strategies as st

VALUES = np.random.default_rng(0).integers(0, 250, (4, 20, 24)).astype(np.int16)
SETTINGS = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
EXTREMES = st.sampled_from(
    [0, 1, -1, 2, 4, 20, 24, 255, 32767, -32768, 65535, 2**31 - 1, -(2**31), 2**32, 2**63, 10**30]
)
NUMBERS = st.one_of(EXTREMES, st.floats(), st.sampled_from([1e300, 1e-300, 0.5]))
WORDS = st.one_of(
    NUMBERS.map(str),
    st.text(max_size=12),
    st.sampled_from(
        [
            "short",
            "uint8",
            "gzip",
            "raw",
            "none",
            "(1,0,0)",
            "LOCAL",
            "LIST",
            "%d 1 2 3",
            "../x",
            "MET_FLOAT",
            "Infinity",
        ]
    ),
)


def look(path):
    """Read; what it may not do is raise anything but a sentence."""
    try:
        assert isinstance(read_volume(path), Volume)
    except CtmcError as error:
        text = str(error)
        assert "\n" not in text and len(text) < 450, text  # noqa: PT018  (both fail with the sentence)


def fields_of(dtype):
    """Some fields of a NumPy record, each with a number."""
    return st.dictionaries(st.sampled_from(sorted(dtype.names)), NUMBERS, min_size=1, max_size=5)


def with_fields(header, changes):
    """The record with numbers in fields as far as they fit."""
    for name, value in changes.items():
        place = header[name].reshape(-1) if header[name].dtype.kind in "iuf" else None
        if place is None or not place.size:
            continue
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                place[len(name) % place.size] = value
            except (OverflowError, ValueError):
                place[len(name) % place.size] = -1 if place.dtype.kind == "i" else 255
    return header


@pytest.mark.parametrize("kind", ["Nifti1Image", "Nifti2Image"])
@pytest.mark.parametrize("end", ["nii", "nii.gz"])
def test_nifti(tmp_path, kind, end):
    image = getattr(nibabel, kind)(VALUES.T, np.eye(4))
    nibabel.save(image, tmp_path / "whole.nii")
    content = (tmp_path / "whole.nii").read_bytes()
    dtype = image.header.template_dtype

    @SETTINGS
    @given(fields_of(dtype))
    def property_of(changes):
        changed = bytearray(content)
        with_fields(np.frombuffer(changed, dtype, 1), changes)
        packed = zlib.compressobj(1, zlib.DEFLATED, 31)
        (tmp_path / f"ct.{end}").write_bytes(
            bytes(changed) if end == "nii" else packed.compress(bytes(changed)) + packed.flush()
        )
        look(tmp_path / f"ct.{end}")

    property_of()


@pytest.mark.parametrize("name", ["ct.mgh", "ct.img"])
def test_mgh_and_analyze(tmp_path, name):
    image = (nibabel.MGHImage if name == "ct.mgh" else nibabel.AnalyzeImage)(VALUES.T, np.eye(4))
    nibabel.save(image, tmp_path / name)
    header = tmp_path / ("ct.mgh" if name == "ct.mgh" else "ct.hdr")
    content = header.read_bytes()
    dtype = image.header.template_dtype

    @SETTINGS
    @given(fields_of(dtype))
    def property_of(changes):
        changed = bytearray(content)
        with_fields(np.frombuffer(changed, dtype.newbyteorder(">" if name == "ct.mgh" else "<"), 1), changes)
        header.write_bytes(bytes(changed))
        look(tmp_path / name)

    property_of()


NRRD = {
    "type": "short", "dimension": "3", "sizes": "24 20 4", "endian": "little", "encoding": "raw", "space": "LPS",
    "space directions": "(1,0,0) (0,1,0) (0,0,2)", "space origin": "(0,0,0)", "kinds": "domain domain domain",
    "spacings": "1 1 1", "byte skip": "0", "line skip": "0", "data file": "all.raw", "space units": '"mm" "mm" "mm"',
}  # fmt: skip
META = {
    "ObjectType": "Image", "NDims": "3", "BinaryData": "True", "BinaryDataByteOrderMSB": "False",
    "CompressedData": "False", "TransformMatrix": "1 0 0 0 1 0 0 0 1", "Offset": "0 0 0", "ElementSpacing": "1 1 2",
    "DimSize": "24 20 4", "HeaderSize": "0", "ElementNumberOfChannels": "1", "ElementType": "MET_SHORT",
    "ElementDataFile": "all.raw",
}  # fmt: skip


@pytest.mark.once
@pytest.mark.parametrize(
    ("name", "head", "sign", "fields"), [("ct.nhdr", "NRRD0004\n", ": ", NRRD), ("ct.mhd", "", " = ", META)]
)
def test_headers_in_words(tmp_path, name, head, sign, fields):
    (tmp_path / "all.raw").write_bytes(VALUES.tobytes())
    words = st.lists(WORDS, min_size=1, max_size=4).map(" ".join)

    @SETTINGS
    @given(st.dictionaries(st.sampled_from(sorted(fields)), st.one_of(st.none(), words), max_size=4))
    def property_of(changes):
        said = {**fields, **changes}
        text = head + "".join(f"{field}{sign}{value}\n" for field, value in said.items() if value is not None) + "\n"
        (tmp_path / name).write_bytes(text.encode("utf-8", "surrogatepass"))
        look(tmp_path / name)

    property_of()


def test_npy(tmp_path):
    sides = st.one_of(EXTREMES, st.booleans(), st.floats(), st.text(max_size=3))
    descr = st.sampled_from(["<i2", ">f4", "|O", "|V8", "<c8", "<f2", "|b1", "<U3", [("a", "<i2")], "x", 3])

    @SETTINGS
    @given(descr, st.one_of(st.booleans(), st.integers()), st.lists(sides, max_size=5).map(tuple), st.integers(0, 3))
    def property_of(kind, fortran, shape, version):
        header = repr({"descr": kind, "fortran_order": fortran, "shape": shape}).encode("utf-8", "surrogatepass")
        length = struct.pack("<H" if version < 2 else "<I", len(header))
        (tmp_path / "ct.npy").write_bytes(b"\x93NUMPY" + bytes([version, 0]) + length + header + VALUES.tobytes())
        look(tmp_path / "ct.npy")

    property_of()


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_tiff(tmp_path, compression):
    path = tmp_path / "ct.tif"
    tifffile.imwrite(path, VALUES, photometric="minisblack", compression=compression)
    content = path.read_bytes()
    with tifffile.TiffFile(path) as tiff:
        offsets = [tag.offset for page in tiff.pages for tag in page.tags]

    @SETTINGS
    @given(
        st.sampled_from(offsets),
        st.one_of(st.none(), st.integers(0, 65535)),
        st.integers(0, 20),
        st.sampled_from([0, 1, 2, 4, 2**16, 2**32 - 1]),
        st.sampled_from([0, 1, 2, 3, 5, 8, 16, 20, 24, 255, 2**15, 2**31, 2**32 - 1]),
    )
    def property_of(at, code, kind, count, value):
        changed = bytearray(content)
        if code is not None:
            changed[at : at + 2] = struct.pack("<H", code)
        changed[at + 2 : at + 12] = struct.pack("<HII", kind, count, value)
        path.write_bytes(bytes(changed))
        look(path)

    property_of()


def test_png(tmp_path):
    stream = io.BytesIO()
    Image.fromarray(VALUES[0].astype(np.uint8)).save(stream, "PNG")
    content = stream.getvalue()
    for number in (0, 2):
        (tmp_path / f"{number}.png").write_bytes(content)
    sides = st.sampled_from([0, 1, 20, 24, 25, 2**15, 2**31 - 1, 2**32 - 1])

    @SETTINGS
    @given(sides, sides, st.integers(0, 17), st.integers(0, 7), st.integers(0, 2), st.integers(0, 2), st.integers(0, 2))
    def property_of(width, height, depth, color, packing, filtering, interlace):
        head = b"IHDR" + struct.pack(">II5B", width, height, depth, color, packing, filtering, interlace)
        (tmp_path / "1.png").write_bytes(content[:12] + head + struct.pack(">I", zlib.crc32(head)) + content[33:])
        look(tmp_path)

    property_of()


DICOM = (
    "Rows", "Columns", "SamplesPerPixel", "BitsAllocated", "BitsStored", "HighBit", "PixelRepresentation",
    "NumberOfFrames", "PixelSpacing", "ImagePositionPatient", "ImageOrientationPatient", "RescaleSlope",
    "RescaleIntercept", "RescaleType", "InstanceNumber", "Modality", "ImageType", "PhotometricInterpretation",
    "PixelPaddingValue", "PixelPaddingRangeLimit", "AcquisitionNumber", "TemporalPositionIdentifier",
    "SliceThickness", "SeriesInstanceUID", "SOPClassUID",
)  # fmt: skip


def test_dicom(tmp_path):
    pydicom = pytest.importorskip("pydicom")
    from fuzz.dicom_seeds import ct_dataset

    for number in range(3):
        pydicom.dcmwrite(tmp_path / f"{number}.dcm", ct_dataset(number, VALUES[number].astype(np.uint16)))
    content = (tmp_path / "1.dcm").read_bytes()
    words = st.lists(WORDS, min_size=1, max_size=6).map("\\".join)

    @SETTINGS
    @given(st.dictionaries(st.sampled_from(DICOM), st.one_of(words, st.integers(0, 65535)), min_size=1, max_size=3))
    def property_of(changes):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            dataset = pydicom.dcmread(io.BytesIO(content), force=True)
            for keyword, value in changes.items():
                number = struct.pack("<H", value) if isinstance(value, int) else value.encode("utf-8", "replace")
                tag = pydicom.tag.Tag(keyword)
                vr = pydicom.datadict.dictionary_VR(keyword).split(" ")[0]
                dataset[tag] = pydicom.dataelem.RawDataElement(tag, vr, len(number), number, 0, False, True)
            dataset.save_as(tmp_path / "1.dcm")
        look(tmp_path)

    property_of()


@SETTINGS
@given(
    st.sampled_from([b"\xff\xd8", b"\xff\x4f\xff\x51", b"\x00\x00\x00\x0cjP", b""]),
    st.binary(max_size=60),
    st.sampled_from([b"", b"\xff\xd9", b"\xff\xd9\x00", b"\x00"]),
)
def test_compressed_frames(start, body, end):
    assert isinstance(frame_damage(start + body + end, 20, 24, 1), str)
