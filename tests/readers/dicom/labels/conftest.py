# SPDX-License-Identifier: GPL-3.0-or-later
"""Segmentations and structure sets made for the tests, with pydicom alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

AXIAL = (1, 0, 0, 0, 1, 0)
SEG = "1.2.840.10008.5.1.4.1.1.66.4"
LABEL_MAP = "1.2.840.10008.5.1.4.1.1.66.7"
RTSTRUCT = "1.2.840.10008.5.1.4.1.1.481.3"
RLE = "1.2.840.10008.1.2.5"
EXPLICIT, IMPLICIT, DEFLATED = "1.2.840.10008.1.2.1", "1.2.840.10008.1.2", "1.2.840.10008.1.2.1.99"
DEFLATED_FRAMES = "1.2.840.10008.1.2.8.1"
RED, GREEN = (34886, 53484, 50172), (57498, 10747, 54274)  # CIELab
PATIENT = "Muster^Erika"


def rle_frame(content: bytes) -> bytes:
    """One segment of PackBits runs (PS3.5 annex G), repeated and literal."""
    runs = bytearray()
    at = 0
    while at < len(content):
        same = 1
        while same < 128 and content[at + same : at + same + 1] == content[at : at + 1]:
            same += 1
        if same > 1:
            runs += bytes([257 - same, content[at]])
        else:
            runs += bytes([0, content[at]])
        at += same
    runs += b"\0" * (len(runs) % 2)
    return (1).to_bytes(4, "little") + (64).to_bytes(4, "little") + bytes(56) + runs


def item(**values: Any) -> Any:
    from pydicom.dataset import Dataset

    dataset = Dataset()
    for name, value in values.items():
        setattr(dataset, name, value)
    return dataset


def _empty(sop_class: str, syntax: str, modality: str) -> Any:
    from pydicom import uid
    from pydicom.dataset import FileMetaDataset

    dataset = item(SOPClassUID=sop_class, SOPInstanceUID=uid.generate_uid(), Modality=modality, PatientName=PATIENT)
    dataset.file_meta = FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = uid.UID(syntax)
    dataset.file_meta.MediaStorageSOPClassUID = sop_class
    dataset.file_meta.MediaStorageSOPInstanceUID = dataset.SOPInstanceUID
    dataset.SeriesInstanceUID = "1.2.3.4.7"
    return dataset


@pytest.fixture
def save_segmentation() -> Callable[..., Any]:
    """Write a DICOM segmentation of the CT that `save_stack` writes.

    `frames` are (segment, (x, y, z), pixels): masks, fractions, or labels where the segment is None.
    """

    def save(
        path: Path,
        frames: Any,
        kind: str = "BINARY",
        names: Any = ("liver", "tumor", "vessel"),
        syntax: str = EXPLICIT,
        undefined: bool = False,
        orientation: Any = AXIAL,
        spacing: Any = (0.8, 0.5),
        gap: float | None = None,
        bits: int = 8,
        bit_packed: bool = True,
        **tags: Any,
    ) -> Any:
        import pydicom
        from pydicom.encaps import encapsulate

        dataset = _empty(LABEL_MAP if kind == "LABELMAP" else SEG, syntax, "SEG")
        dataset.SegmentationType = kind
        dataset.SpecificCharacterSet = "ISO_IR 192"
        dataset.FrameOfReferenceUID = "1.2.3.4.8"
        dataset.ReferencedSeriesSequence = [item(SeriesInstanceUID="1.2.3.4.5")]
        pixels = [np.asarray(stored) for _, _, stored in frames]
        dataset.Rows, dataset.Columns = pixels[0].shape
        dataset.NumberOfFrames = len(frames)
        dataset.SamplesPerPixel, dataset.PhotometricInterpretation, dataset.PixelRepresentation = 1, "MONOCHROME2", 0
        dataset.BitsAllocated = dataset.BitsStored = 1 if kind == "BINARY" else bits
        dataset.HighBit = dataset.BitsStored - 1
        if kind == "FRACTIONAL":
            dataset.MaximumFractionalValue = 255
        dataset.SegmentSequence = [
            item(SegmentNumber=number, SegmentLabel=name, RecommendedDisplayCIELabValue=list((RED, GREEN)[number % 2]))
            for number, name in enumerate(names, 1)
        ]
        groups = []
        for segment, position, _ in frames:
            group = item(PlanePositionSequence=[item(ImagePositionPatient=list(position))])
            if segment is not None:
                group.SegmentIdentificationSequence = [item(ReferencedSegmentNumber=segment)]
            group.is_undefined_length_sequence_item = undefined
            groups.append(group)
        measures = item(PixelSpacing=list(spacing), **({} if gap is None else {"SpacingBetweenSlices": gap}))
        dataset.SharedFunctionalGroupsSequence = [
            item(
                PlaneOrientationSequence=[item(ImageOrientationPatient=list(orientation))],
                PixelMeasuresSequence=[measures],
            )
        ]
        dataset.PerFrameFunctionalGroupsSequence = groups
        dataset["PerFrameFunctionalGroupsSequence"].is_undefined_length = undefined
        stack = np.stack(pixels)
        packed = [np.packbits(plane.ravel() != 0, bitorder="little").tobytes() for plane in stack]
        if kind != "BINARY":
            packed = [plane.astype(f"<u{bits // 8}").tobytes() for plane in stack]
        if syntax == DEFLATED_FRAMES:
            import zlib

            streams = [zlib.compressobj(wbits=-15) for _ in packed]
            pairs = zip(streams, packed, strict=True)
            dataset.PixelData = encapsulate([stream.compress(piece) + stream.flush() for stream, piece in pairs])
        elif syntax == RLE:
            if kind == "BINARY" and not bit_packed:
                packed = [plane.astype(np.uint8).tobytes() for plane in stack]
            dataset.PixelData = encapsulate([rle_frame(piece) for piece in packed])
        elif kind == "BINARY":  # bits of all frames without a gap
            dataset.PixelData = np.packbits(stack.ravel() != 0, bitorder="little").tobytes()
        else:
            dataset.PixelData = b"".join(packed)
        if len(dataset.PixelData) % 2:
            dataset.PixelData += b"\0"
        dataset["PixelData"].VR = "OW" if bits == 16 else "OB"
        dataset["PixelData"].is_undefined_length = syntax in (DEFLATED_FRAMES, RLE)
        for name, value in tags.items():
            if value is None:
                delattr(dataset, name)
            else:
                setattr(dataset, name, value)
        path.parent.mkdir(parents=True, exist_ok=True)
        if syntax == DEFLATED_FRAMES:  # which pydicom does not know
            dataset.preamble = bytes(128)
            pydicom.dcmwrite(path, dataset, implicit_vr=False, little_endian=True, force_encoding=True)
        else:
            pydicom.dcmwrite(path, dataset, enforce_file_format=True)
        return dataset

    return save


@pytest.fixture
def save_structures() -> Callable[..., Any]:
    """Write a structure set of the CT that `save_stack` writes; `regions` are name: [(type, positions (n, 3))].

    Without `frame` no frame of reference is named for the whole set. `images` names one image for each contour.
    """

    def save(
        path: Path,
        regions: Any,
        syntax: str = IMPLICIT,
        color: Any = (255, None, 0),
        frame: bool = True,
        region_frame: str | None = None,
        images: Any = None,
        **tags: Any,
    ) -> Any:
        import pydicom

        dataset = _empty(RTSTRUCT, syntax, "RTSTRUCT")
        dataset.SpecificCharacterSet = "ISO_IR 100"
        series = item(SeriesInstanceUID="1.2.3.4.5")
        study = item(RTReferencedSeriesSequence=[series])
        if frame:
            dataset.ReferencedFrameOfReferenceSequence = [
                item(FrameOfReferenceUID="1.2.3.4.8", RTReferencedStudySequence=[study])
            ]
        dataset.StructureSetROISequence, dataset.ROIContourSequence = [], []
        for at, (name, contours) in enumerate(regions.items()):
            number = 10 + 3 * at
            region = item(ROINumber=number, ROIName=name)
            if region_frame is not None:
                region.ReferencedFrameOfReferenceUID = region_frame
            dataset.StructureSetROISequence.append(region)
            drawn = [
                item(
                    ContourGeometricType=kind,
                    NumberOfContourPoints=len(points),
                    ContourData=[f"{value:.4f}" for value in np.ravel(points)],
                )
                for kind, points in contours
            ]
            for contour in drawn if images else ():
                contour.ContourImageSequence = [item(ReferencedSOPInstanceUID=images)]
            own_color = [10 * at if share is None else share for share in color]
            dataset.ROIContourSequence.append(
                item(ReferencedROINumber=number, ROIDisplayColor=own_color, ContourSequence=drawn)
            )
        for name, value in tags.items():
            setattr(dataset, name, value)
        path.parent.mkdir(parents=True, exist_ok=True)
        pydicom.dcmwrite(path, dataset, enforce_file_format=True)
        return dataset

    return save
