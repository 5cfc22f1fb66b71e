"""DICOM headers: one pass over a file gives all that is needed of it, and where its pixels begin.

Only tags about the image and its place are asked for; nothing about the patient is read.
Positions are in DICOM's LPS+ mm. Clauses are those of DICOM PS3.3 and PS3.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

from ..file_formats import DICOM_SUFFIXES, KNOWN_SUFFIXES, suffix
from ..optional_imports import BROKEN, needed, quiet
from .frames import FrameGeometry, frame_geometries
from .plain_header import LONGEST, plain_header

WHAT = "DICOM"
TAGS = [
    "SOPClassUID",
    "Modality",
    "ImageType",
    "SeriesInstanceUID",
    "InstanceNumber",
    "ImagePositionPatient",
    "ImageOrientationPatient",
    "NumberOfFrames",
    "SamplesPerPixel",
    "PhotometricInterpretation",
    "Rows",
    "Columns",
    "PixelSpacing",
    "BitsAllocated",
    "BitsStored",
    "PixelRepresentation",
    "PixelPaddingValue",
    "PixelPaddingRangeLimit",
    "RescaleSlope",
    "RescaleIntercept",
    "RescaleType",
    "ModalityLUTSequence",
    "SharedFunctionalGroupsSequence",
    "PerFrameFunctionalGroupsSequence",
]
NOT_SLICES = ("SEG", "RTSTRUCT", "RTDOSE", "RTPLAN", "SR", "PR", "KO", "REG", "DOC")
DEFLATED = "1.2.840.10008.1.2.1.99"
IMPLICIT_LITTLE = "1.2.840.10008.1.2"
UNCOMPRESSED = (IMPLICIT_LITTLE, "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2", DEFLATED)


class Pixels(NamedTuple):
    """How a file stores its pixels."""

    syntax: str  # transfer syntax UID
    compressed: bool
    start: int | None  # first byte of uncompressed pixels; None where pydicom has to find them
    size: int  # bytes of uncompressed pixels that the file says it has
    big_endian: bool
    floating: bool
    allocated: int
    stored: int
    signed: bool
    padding: tuple[int, int] | None  # lowest and highest stored value that means 'no pixel'


@dataclass(frozen=True, eq=False)
class ImageFile:
    """What one DICOM file with an image says of it; carries no patient data."""

    path: Path
    series: str
    modality: str
    rows: int
    columns: int
    instance: int
    scout: bool
    grey: bool
    hounsfield: bool
    lookup: bool  # a modality look-up table in place of slope and intercept
    pixels: Pixels
    frames: tuple[FrameGeometry, ...]


class Broken(NamedTuple):
    """A DICOM image that ends too early or cannot be understood."""

    path: Path
    series: str  # empty where it is not known
    stray: bool = False  # has a DICOM file's name and nothing else of one


def read_header(path: Path) -> ImageFile | Broken | None:
    """The header of a DICOM image; None where the file is something else."""
    return read_plain(path) or read_by_pydicom(path)


def read_plain(path: Path) -> ImageFile | None:
    """The header of a plain CT slice, in a twentieth of pydicom's time; None where pydicom has to be asked."""
    if may_be_another(path):
        return None
    with path.open("rb") as file:
        try:
            header = plain_header(file.read(LONGEST))
            if header is None:
                return None
            file.seek(header.end)
            image = _image(path, header, _pixels(header, file), str(header.get("SeriesInstanceUID", "")))
        except (TypeError, ValueError):
            return None
    return image if isinstance(image, ImageFile) else None


def read_by_pydicom(path: Path) -> ImageFile | Broken | None:
    """The header of any DICOM image; None where the file is something else."""
    if may_be_another(path):
        return None
    with path.open("rb") as file:
        preamble = has_preamble(file)
        if not preamble and not looks_like_dataset(file):
            return Broken(path, "", stray=True) if suffix(path) in DICOM_SUFFIXES else None
        return _parsed(path, file, preamble)


def may_be_another(path: Path) -> bool:
    """Whether the name says that a file is no DICOM image."""
    return path.name.upper() == "DICOMDIR" or (suffix(path) in KNOWN_SUFFIXES and suffix(path) not in DICOM_SUFFIXES)


def pydicom_errors() -> tuple[type[Exception], ...]:
    """What pydicom raises on broken files; some of its own errors derive from nothing common."""
    errors = vars(needed("pydicom.errors", "pydicom", WHAT)).values()
    return (*BROKEN, *(one for one in errors if isinstance(one, type) and issubclass(one, Exception)))


def has_preamble(file: IO[bytes]) -> bool:
    """Whether 'DICM' stands where PS3.10 wants it; leaves `file` at its start."""
    head = file.read(132)
    file.seek(0)
    return head[128:] == b"DICM"


def looks_like_dataset(file: IO[bytes]) -> bool:
    """Whether the file begins like a DICOM dataset that lost its preamble; leaves `file` at its start."""
    head = file.read(8)
    file.seek(0)
    if len(head) < 8 or head[:2] not in (b"\x02\x00", b"\x08\x00"):
        return False
    explicit = head[4:6].isalpha() and head[4:6].isupper()
    return explicit or int.from_bytes(head[4:8], "little") < 1024


def _parsed(path: Path, file: IO[bytes], preamble: bool) -> ImageFile | Broken | None:
    pydicom = needed("pydicom", "pydicom", WHAT)
    series, image = "", False
    try:
        with quiet():
            dataset = pydicom.dcmread(file, stop_before_pixels=True, force=not preamble, specific_tags=TAGS)
            series = str(dataset.get("SeriesInstanceUID", None) or "")
            kind = sop_class(dataset)
            if not kind or (kind[0].isdigit() and not series):  # cut off before, or in the midst of it
                return Broken(path, series) if preamble else None
            image = "Image Storage" in kind and "Segmentation" not in kind
            if str(dataset.get("Modality", "")) in NOT_SLICES or "Rows" not in dataset:
                return Broken(path, series) if image and "Rows" not in dataset else None
            pixels = _pixels(dataset, file)
            return None if pixels is None and not image else _image(path, dataset, pixels, series)
    except pydicom_errors():
        return Broken(path, series) if preamble or image else None


def sop_class(dataset: Any) -> str:
    """Name of what the file says it stores, such as 'CT Image Storage'; empty where it does not say."""
    kind = dataset.get("SOPClassUID", None) or dataset.file_meta.get("MediaStorageSOPClassUID", None)
    return str(getattr(kind, "name", ""))


def _image(path: Path, dataset: Any, pixels: Pixels | None, series: str) -> ImageFile | Broken:
    if pixels is None:
        return Broken(path, series)
    words = [str(word).strip().upper() for word in as_list(dataset.get("ImageType", None))]
    modality = str(dataset.get("Modality", None) or "")
    unit = str(dataset.get("RescaleType", None) or "HU").upper()
    frames = frame_geometries(dataset)
    return ImageFile(
        path=path,
        series=series,
        modality=modality,
        rows=int(dataset.Rows),
        columns=int(dataset.Columns),
        instance=int(dataset.get("InstanceNumber", None) or 0),
        scout="LOCALIZER" in words,
        grey=int(dataset.get("SamplesPerPixel", 1)) == 1 and "MONOCHROME" in str(dataset.PhotometricInterpretation),
        hounsfield=modality == "CT" and unit == "HU" and all(frame.unit in ("", "HU") for frame in frames),
        lookup=bool(dataset.get("ModalityLUTSequence", None)),
        pixels=pixels,
        frames=frames,
    )


def as_list(value: Any) -> list[Any]:
    """A DICOM value of multiplicity 0, 1 or more as a list."""
    if value is None:
        return []
    return [value] if isinstance(value, str) else list(value)


def _pixels(dataset: Any, file: IO[bytes]) -> Pixels | None:
    """How the pixels are stored, `file` standing at their element; None where the file ends before it."""
    syntax = dataset.file_meta.get("TransferSyntaxUID", None)
    implicit, little = dataset.original_encoding
    known = str(syntax) if syntax else IMPLICIT_LITTLE
    compressed = known not in UNCOMPRESSED
    start: int | None = None
    size, floating = 0, False
    if known != DEFLATED:  # else the file's position says nothing
        at = file.tell()
        head = file.read(12)
        order: Literal["little", "big"] = "little" if little else "big"
        if len(head) < 12:
            return None
        group, element = (int.from_bytes(head[two : two + 2], order) for two in (0, 2))
        floating = group == 0x7FE0 and element in (0x0008, 0x0009)
        if (group, element) == (0x7FE0, 0x0010) and not compressed:
            # PS3.5 7.1: implicit VR has tag and length, explicit OB and OW have VR and two zero bytes between.
            start = at + (8 if implicit else 12)
            size = int.from_bytes(head[4:8] if implicit else head[8:12], order)
    allocated = int(dataset.BitsAllocated)
    stored = int(dataset.get("BitsStored", None) or allocated)
    signed = bool(dataset.get("PixelRepresentation", 0))
    padding = dataset.get("PixelPaddingValue", None)
    limit = dataset.get("PixelPaddingRangeLimit", None)
    ends = [as_stored(value, allocated, signed) for value in (padding, padding if limit is None else limit)]
    whole = [end for end in ends if end is not None]
    return Pixels(
        known,
        compressed,
        start,
        size,
        not little,
        floating,
        allocated,
        stored,
        signed,
        (min(whole), max(whole)) if len(whole) == 2 else None,
    )


def as_stored(value: Any, bits: int, signed: bool) -> int | None:
    """A padding value as the pixels hold it: scanners write 63536 where signed pixels have -2000.

    Examples
    --------
    >>> as_stored(63536, 16, True)
    -2000
    """
    if value is None:
        return None
    number = int.from_bytes(value[: bits // 8], "little") if isinstance(value, bytes) else int(value)
    number %= 1 << bits
    return number - (1 << bits) if signed and number >= 1 << (bits - 1) else number
