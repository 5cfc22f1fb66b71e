"""Plain CT headers read without pydicom, which is the oracle: both must say the same of every file."""

import numpy as np
import pytest
from pydicom import uid
from pydicom.dataset import Dataset

from ctmc_addon.readers.dicom.header import ImageFile, read_by_pydicom, read_header, read_plain
from ctmc_addon.readers.dicom.plain_header import LONGEST

PIXELS = np.arange(6, dtype=np.int16).reshape(2, 3)


def facts(header):
    """Everything a header says, by name; `repr` since NaN and -0.0 count too."""
    return {name: repr(value) for name, value in vars(header).items()}


def same(one, other):
    return type(one) is type(other) and facts(one) == facts(other)


def nested(depth):
    """A dataset with a sequence in a sequence, lengths left open, and tags that must not be taken for its own."""
    inside = Dataset()
    inside.Rows, inside.Modality, inside.PixelSpacing = 999, "MR", [9, 9]
    inside.is_undefined_length_sequence_item = True
    if depth:
        inside.IconImageSequence = [nested(depth - 1)]
        inside["IconImageSequence"].is_undefined_length = True
        inside.BitsAllocated, inside.PixelData = 16, b"\0" * 8
        inside["PixelData"].VR = "OW"
    return inside


VARIANTS = {
    "as it is": {},
    "no slope": {"RescaleSlope": None, "RescaleIntercept": None},
    "fractions": {"RescaleSlope": "0.123456789", "RescaleIntercept": "-1e3", "PixelSpacing": ["0.7", "7.25E-1"]},
    "kinds": {"ImageType": ["ORIGINAL", "PRIMARY", "LOCALIZER"], "RescaleType": "HU"},
    "other unit": {"RescaleType": "US"},
    "padding": {"PixelPaddingValue": -2000, "PixelPaddingRangeLimit": -1999},
    "empty": {"InstanceNumber": "", "RescaleType": "", "ImagePositionPatient": []},
    "no series": {"SeriesInstanceUID": None},
    "12 bits": {"BitsStored": 12, "InstanceNumber": 7},
    "colour": {"PhotometricInterpretation": "RGB"},
    "text": {"SpecificCharacterSet": "ISO_IR 192", "InstitutionName": "Ä 東"},
}


@pytest.mark.parametrize("syntax", [uid.ImplicitVRLittleEndian, uid.ExplicitVRLittleEndian])
@pytest.mark.parametrize("name", VARIANTS)
def test_a_plain_header_says_what_pydicom_says(tmp_path, save_slice, syntax, name):
    save_slice(tmp_path / "a.dcm", PIXELS, (1, -2.5, 3e-3), syntax, **VARIANTS[name])
    plain = read_plain(tmp_path / "a.dcm")
    assert isinstance(plain, ImageFile)
    assert facts(plain) == facts(read_by_pydicom(tmp_path / "a.dcm"))


@pytest.mark.parametrize("syntax", [uid.ImplicitVRLittleEndian, uid.ExplicitVRLittleEndian])
def test_tags_inside_sequences_are_not_the_slices_own(tmp_path, save_slice, syntax):
    inside = nested(2)
    save_slice(tmp_path / "a.dcm", PIXELS, syntax=syntax, ReferencedImageSequence=[inside, nested(0)])
    plain = read_plain(tmp_path / "a.dcm")
    assert (plain.rows, plain.modality) == (2, "CT")
    assert same(plain, read_by_pydicom(tmp_path / "a.dcm"))


def test_compressed_slices_have_plain_headers_too(tmp_path, save_slice):
    save_slice(tmp_path / "a.dcm", PIXELS, compress=uid.RLELossless)
    plain = read_plain(tmp_path / "a.dcm")
    assert plain.pixels.compressed
    assert plain.pixels.start is None
    assert same(plain, read_by_pydicom(tmp_path / "a.dcm"))


@pytest.mark.parametrize(
    "tags",
    [
        {"syntax": uid.ExplicitVRBigEndian},
        {"syntax": uid.DeflatedExplicitVRLittleEndian},
        {"Modality": "MR", "SOPClassUID": "1.2.840.10008.5.1.4.1.1.4"},
        {"NumberOfFrames": 1},
        {"InstanceNumber": "", "EncapsulatedDocument": b"x" * LONGEST},
    ],
    ids=["big endian", "deflated", "MR", "frames", "a long header"],
)
def test_what_is_not_plain_is_left_to_pydicom(tmp_path, save_slice, tags):
    save_slice(tmp_path / "a.dcm", PIXELS, **tags)
    assert read_plain(tmp_path / "a.dcm") is None
    assert isinstance(read_header(tmp_path / "a.dcm"), ImageFile)


def test_a_file_without_preamble_is_left_to_pydicom(tmp_path, save_slice):
    save_slice(tmp_path / "a.dcm", PIXELS)
    (tmp_path / "b.dcm").write_bytes((tmp_path / "a.dcm").read_bytes()[132:])
    assert read_plain(tmp_path / "b.dcm") is None
    assert isinstance(read_header(tmp_path / "b.dcm"), ImageFile)


@pytest.mark.parametrize("syntax", [uid.ImplicitVRLittleEndian, uid.ExplicitVRLittleEndian])
def test_a_damaged_header_is_never_read_otherwise_than_by_pydicom(tmp_path, save_slice, syntax):
    whole, file = tmp_path / "a.dcm", tmp_path / "b.dcm"
    save_slice(whole, PIXELS, syntax=syntax, ReferencedImageSequence=[nested(1)], PixelPaddingValue=-2000)
    good = whole.read_bytes()
    random = np.random.default_rng(5)
    read = 0
    for cut in range(128, len(good), 9):
        file.write_bytes(good[:cut])
        plain = read_plain(file)
        assert plain is None or same(plain, read_by_pydicom(file)), cut
    for _ in range(250):
        raw = bytearray(good)
        at = int(random.integers(132, len(good)))
        raw[at] = random.choice([32, 92, 255, random.integers(1, 256)])
        file.write_bytes(raw)
        plain = read_plain(file)
        assert plain is None or same(plain, read_by_pydicom(file)), (at, raw[at])
        read += plain is not None
    assert read > 100  # or nothing was compared


@pytest.mark.parametrize(
    "name", ["lidc0314_abdomen30", "ge_gantry_tilt", "kits_dupe_positions", "ts_dicom_j2k", "dicom_singles"]
)
def test_real_headers_say_what_pydicom_says(real, name):
    plain = {path: read_plain(path) for path in real(name).iterdir()}
    read = {path: header for path, header in plain.items() if header is not None}
    assert len(read) >= (3 if name == "dicom_singles" else len(plain) - 1)
    assert all(same(header, read_by_pydicom(path)) for path, header in read.items())
