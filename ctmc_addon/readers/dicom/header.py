# SPDX-License-Identifier: GPL-3.0-or-later
"""Read DICOM headers with pydicom, in one pass over each file that skips the pixels.

Only elements about the image and its place are read, none about the patient.
Positions are in DICOM's LPS+ mm. Clauses are those of DICOM PS3.3 and PS3.5.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO, Any, NamedTuple

from ..file_formats import suffix
from ..optional_imports import needed, quiet
from ..registry import BY_FILE_NAME, BY_SUFFIX
from .deflated import DEFLATED, unpacks_without_end
from .dose_frames import dose_frames, dose_remarks
from .frames import FrameGeometry, WrongGroups, frame_geometries
from .labels.classes import label_class
from .pixels.pixel_format import Pixels, missing_pixels, padding_ends, unusable_number

IMPLICIT_LITTLE, EXPLICIT_LITTLE, EXPLICIT_BIG = "1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2"
UNCOMPRESSED = (IMPLICIT_LITTLE, EXPLICIT_LITTLE, EXPLICIT_BIG, DEFLATED)
NOT_SLICES = {"SEG", "RTSTRUCT", "RTDOSE", "RTPLAN", "SR", "PR", "KO", "REG", "DOC"}  # Files of these modalities.
PIXEL_KEYWORDS = ("PixelData", "FloatPixelData", "DoubleFloatPixelData")
CALLED_KEYWORDS = ("SeriesNumber", "SeriesDescription", "ConvolutionKernel")
KEYWORDS = (
    *("SpecificCharacterSet", "ImageType", "SOPClassUID", "SOPInstanceUID", "Modality", "SeriesInstanceUID"),
    *("AcquisitionTime", "ContentTime", "TriggerTime", "AcquisitionNumber", "InstanceNumber"),
    *("TemporalPositionIdentifier", "ImagePositionPatient", "ImageOrientationPatient", "FrameOfReferenceUID"),
    *("SamplesPerPixel", "PhotometricInterpretation", "PlanarConfiguration", "NumberOfFrames", "Rows", "Columns"),
    *("PixelSpacing", "BitsAllocated", "BitsStored", "HighBit", "PixelRepresentation"),
    *("PixelPaddingValue", "PixelPaddingRangeLimit", "RescaleIntercept", "RescaleSlope", "RescaleType"),
    *("ModalityLUTSequence", "SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"),
    *("ExtendedOffsetTable", "ExtendedOffsetTableLengths"),
    *("GridFrameOffsetVector", "DoseGridScaling", "DoseUnits", "DoseType", "DoseSummationType"),
    *CALLED_KEYWORDS,
    *PIXEL_KEYWORDS,
)
LONGEST_CALLED = 64  # Letters of a description that are shown.
LONGEST_VALUE = 1 << 16  # Longer values, in bytes, are skipped until they are needed; pixels are.
DOSE_MODALITY = "RTDOSE"
EXPORT = "export it again"  # The remedy where the header is wrong, not the copy of the file.


class Called(NamedTuple):
    """The descriptions of a series by its operator; they may hold names, so they are shown on the screen only."""

    number: str
    description: str
    kernel: str


@dataclass(frozen=True, eq=False)
class ImageFile:
    """The description of the image in one DICOM file, without patient data."""

    path: Path
    series: str
    modality: str
    rows: int
    columns: int
    uid: str  # SOPInstanceUID
    frame_of_reference: str  # UID of the coordinates, which other series may share
    instance: int
    called: Called  # For the screen only.
    scout: bool
    gray: bool
    hounsfield: bool
    lookup: bool  # True for a modality look-up table instead of slope and intercept.
    pixels: Pixels
    frames: tuple[FrameGeometry, ...]
    float_values: bool = False  # True where values are float32, whatever the slopes.
    remarks: tuple[str, ...] = ()  # Of a dose, for notes.

    @property
    def is_float(self) -> bool:
        """Return whether values are float32."""
        return self.float_values or self.pixels.floating


class Slice(NamedTuple):
    """One frame of one file."""

    image: ImageFile
    frame: int

    @property
    def geometry(self) -> FrameGeometry:
        """Return position and scale of this frame."""
        return self.image.frames[self.frame]

    @property
    def name(self) -> str:
        """Return the file's name for errors, with the frame if there are several."""
        several = len(self.image.frames) > 1
        return f"{self.image.path.name} frame {self.frame + 1}" if several else self.image.path.name


class Broken(NamedTuple):
    """A DICOM image that ends too early or cannot be understood."""

    path: Path
    series: str  # Empty if unknown.
    damage: str = ""  # The defect, if known.
    remedy: str = "copy it again"
    stray: bool = False  # True if nothing in the file shows that it is DICOM.


def may_be_dicom(path: Path) -> bool:
    """Return whether a file in a folder is worth parsing: by its suffix and its first bytes."""
    if has_other_suffix(path):
        return False
    try:
        with path.open("rb") as file:
            return _has_preamble(file) or _looks_like_dataset(file)
    except OSError:
        return False


def has_other_suffix(path: Path) -> bool:
    """Return whether the suffix belongs to files other than DICOM images."""
    return path.name.upper() in BY_FILE_NAME or BY_SUFFIX.get(suffix(path), "DICOM") != "DICOM"


def _has_preamble(file: IO[bytes]) -> bool:
    """Return whether the file has 'DICM' at the position of PS3.10; leave `file` at its start."""
    head = file.read(132)
    file.seek(0)
    return head[128:] == b"DICM"


def _looks_like_dataset(file: IO[bytes]) -> bool:
    """Return whether the file begins like a DICOM dataset that lost its preamble; leave `file` at its start."""
    head = file.read(8)
    file.seek(0)
    if len(head) < 8 or head[:2] not in (b"\x02\x00", b"\x08\x00"):
        return False
    explicit = head[4:6].isalpha() and head[4:6].isupper()
    return explicit or int.from_bytes(head[4:8], "little") < 1024


def pydicom_errors() -> tuple[type[Exception], ...]:
    """Return the errors of pydicom on broken files, when it reads them and when it converts a value."""
    own = needed("pydicom.errors", "pydicom", "DICOM")
    library = (own.InvalidDicomError, own.BytesLengthException, struct.error, zlib.error)
    return (
        *library,
        *(OSError, EOFError, ValueError, TypeError, AttributeError, LookupError, RuntimeError, ArithmeticError),
    )


@cache
def _tag_of(keyword: str) -> Any:
    """Return pydicom's tag of a keyword, looked up once instead of once a file."""
    return needed("pydicom.tag", "pydicom", "DICOM").Tag(keyword)


class _DatasetValues:
    """The values of a dataset by keyword; pydicom takes long to look for missing elements, and most are missing."""

    def __init__(self, dataset: Any) -> None:
        self.dataset = dataset
        self.present = frozenset(dataset.keys())

    def __contains__(self, keyword: str) -> bool:
        return _tag_of(keyword) in self.present

    def get(self, keyword: str, default: Any) -> Any:
        """Return a value, or the default where the dataset does not have it."""
        tag = _tag_of(keyword)
        return self.dataset[tag].value if tag in self.present else default


def read_dataset(file: IO[bytes], **options: Any) -> Any:
    """Return the elements of `KEYWORDS`, as pydicom reads them."""
    return needed("pydicom", "pydicom", "DICOM").dcmread(file, specific_tags=list(map(_tag_of, KEYWORDS)), **options)


def read_header(path: Path) -> ImageFile | Broken | None:
    """Return the header of a DICOM image; None for other DICOM objects and for suffixes of other formats."""
    if has_other_suffix(path):
        return None
    with path.open("rb") as file:
        preamble = _has_preamble(file)
        if label_class(path):
            return None
        if preamble or _looks_like_dataset(file):
            return _parsed(path, file, preamble)
    return Broken(path, "", stray=True)


def read_dose_header(path: Path) -> ImageFile | Broken | None:
    """Return the header of a DICOM dose (RTDOSE), whose frames have their places and Gy; None for other objects."""
    with path.open("rb") as file:
        return _parsed(path, file, _has_preamble(file), DOSE_MODALITY)


def is_multi_frame(path: Path) -> bool:
    """Return whether a DICOM file is a volume by itself."""
    if path.name.upper() == "DICOMDIR":
        return False
    with quiet():
        header = read_header(path)
    return isinstance(header, ImageFile) and len(header.frames) > 1


def _parsed(path: Path, file: IO[bytes], preamble: bool, modality: str = "") -> ImageFile | Broken | None:
    series, is_image = "", False
    unreadable: tuple[type[Exception], ...] = (*pydicom_errors(), MemoryError)  # MemoryError: a length of 4 GB
    try:
        if unpacks_without_end(file):
            return Broken(path, "", "it unpacks to far more bytes than its size allows")
        dataset = read_dataset(file, defer_size=LONGEST_VALUE, force=not preamble)
        syntax = _syntax_of(dataset)
        if syntax == DEFLATED:  # skipped values cannot be found again in the file
            file.seek(0)
            dataset = read_dataset(file, force=not preamble)
        elements = _DatasetValues(dataset)
        series = str(elements.get("SeriesInstanceUID", None) or "")
        kind = sop_class(elements)
        if not kind or (kind[0].isdigit() and not series):  # cut off before or within it
            return Broken(path, series, stray=not preamble)
        is_image = "Image Storage" in kind and "Segmentation" not in kind
        if str(elements.get("Modality", "")) in NOT_SLICES - {modality} or "Rows" not in elements:
            return Broken(path, series) if is_image and "Rows" not in elements else None
        keywords = [keyword for keyword in PIXEL_KEYWORDS if keyword in elements]
        if not keywords:
            return Broken(path, series) if is_image else None
        if len(keywords) > 1:
            return Broken(path, series, f"both {keywords[0]} and {keywords[1]}")
        keyword = keywords[0]
        options = options_of(dataset, keyword)
        number = unusable_number(options)
        if number:
            return Broken(path, series, number, EXPORT)
        pixels = pixels_of(elements, syntax, options)
        damage = missing_pixels(pixels, dataset.get_item(keyword, keep_deferred=True).length, file.seek(0, 2))
        return Broken(path, series, damage) if damage else _image_file(path, elements, series, pixels)
    except WrongGroups as error:
        return Broken(path, series, str(error), EXPORT)
    except unreadable:
        return Broken(path, series, stray=not (preamble or is_image))


def kind_in_words(path: Path) -> str:
    """Return the kind of object in a DICOM file, such as 'Encapsulated PDF'; empty if unknown or not DICOM."""
    unreadable: tuple[type[Exception], ...] = (*pydicom_errors(), MemoryError)
    try:
        with quiet(), path.open("rb") as file:
            if not (_has_preamble(file) or _looks_like_dataset(file)) or unpacks_without_end(file):
                return ""
            kind = sop_class(_DatasetValues(read_dataset(file, stop_before_pixels=True, force=True)))
    except unreadable:
        return ""
    return "of a private kind" if kind[:1].isdigit() else kind.removesuffix(" Storage")


def _syntax_of(dataset: Any) -> str:
    """Return the transfer syntax UID, or the one in which the file was read if it names none."""
    implicit, little = dataset.original_encoding
    assumed = IMPLICIT_LITTLE if implicit else EXPLICIT_LITTLE if little else EXPLICIT_BIG
    return str(dataset.file_meta.get("TransferSyntaxUID", None) or assumed)


def one_line(value: Any) -> str:
    """Return printable text of an element, at most 64 characters."""
    values = value if isinstance(value, (list, tuple)) or hasattr(value, "append") else [value]
    words = " ".join("" if item is None else str(item) for item in values).split()
    return "".join(letter for letter in " ".join(words) if letter.isprintable())[:LONGEST_CALLED]


def sop_class(elements: _DatasetValues) -> str:
    """Return the name of the SOP class, such as 'CT Image Storage'; empty if the file has none."""
    kind = elements.get("SOPClassUID", None) or elements.dataset.file_meta.get("MediaStorageSOPClassUID", None)
    return str(getattr(kind, "name", ""))


def _image_file(path: Path, elements: _DatasetValues, series: str, pixels: Pixels) -> ImageFile:
    image_type = elements.get("ImageType", None) or ()
    words = [str(word).strip().upper() for word in ([image_type] if isinstance(image_type, str) else image_type)]
    modality = str(elements.get("Modality", None) or "")
    unit = str(elements.get("RescaleType", None) or "HU").upper()
    options = pixels.options
    is_dose = modality == DOSE_MODALITY
    frames = (dose_frames if is_dose else frame_geometries)(elements, options["number_of_frames"])
    return ImageFile(
        path=path,
        series=series,
        modality=modality,
        rows=options["rows"],
        columns=options["columns"],
        uid=str(elements.get("SOPInstanceUID", None) or ""),
        frame_of_reference=str(elements.get("FrameOfReferenceUID", None) or ""),
        instance=int(elements.get("InstanceNumber", None) or 0),
        called=Called(*(one_line(elements.get(keyword, None)) for keyword in CALLED_KEYWORDS)),
        scout="LOCALIZER" in words,
        gray=int(options.get("samples_per_pixel", 1)) == 1
        and "MONOCHROME" in str(options["photometric_interpretation"]),
        hounsfield=modality == "CT" and unit == "HU" and all(frame.unit in ("", "HU") for frame in frames),
        lookup=bool(elements.get("ModalityLUTSequence", None)),
        pixels=pixels,
        frames=frames,
        float_values=is_dose,
        remarks=dose_remarks(elements) if is_dose else (),
    )


def options_of(dataset: Any, keyword: str) -> dict[str, Any]:
    """Return the storage of the pixels under `keyword` as options of pydicom's decoders."""
    as_options = needed("pydicom.pixels", "pydicom", "DICOM").as_pixel_options
    vr = dataset.get_item(keyword, keep_deferred=True).VR
    options: dict[str, Any] = as_options(dataset, pixel_keyword=keyword, pixel_vr=vr)
    sizes = {option: int(options[option]) for option in ("number_of_frames", "rows", "columns", "bits_allocated")}
    return options | sizes


def pixels_of(elements: _DatasetValues, syntax: str, options: Mapping[str, Any]) -> Pixels:
    """Return the storage of the pixels."""
    keyword = options["pixel_keyword"]
    return Pixels(
        syntax,
        syntax not in UNCOMPRESSED,
        keyword != "PixelData",
        padding_ends(elements, options),
        elements.dataset.get_item(keyword, keep_deferred=True).value_tell,
        options,
        elements.get("HighBit", None),
    )
