# SPDX-License-Identifier: GPL-3.0-or-later
"""Small whole DICOM files: slices, frames, a segmentation, structures, a dose, a PET and a DICOMDIR."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from doses import PET, item, write_dose
from PIL import Image

from .seed_values import BYTES, VALUES, Seed

J2K, RLE, JPEG = "1.2.840.10008.1.2.4.90", "1.2.840.10008.1.2.5", "1.2.840.10008.1.2.4.50"
EXPLICIT, IMPLICIT, BIG = "1.2.840.10008.1.2.1", "1.2.840.10008.1.2", "1.2.840.10008.1.2.2"
DEFLATED = "1.2.840.10008.1.2.1.99"


def ct_dataset(number: int, plane: Any, syntax: str = EXPLICIT) -> Any:
    """One CT slice."""
    from pydicom import uid
    from pydicom.dataset import Dataset, FileMetaDataset

    dataset = Dataset()
    dataset.file_meta = FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = uid.UID(syntax)
    kind = "1.2.840.10008.5.1.4.1.1.2"
    dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = kind
    dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID = f"1.2.3.{number + 1}"
    dataset.SeriesInstanceUID, dataset.StudyInstanceUID, dataset.Modality = "1.2.3.4", "1.2.3", "CT"
    dataset.FrameOfReferenceUID = "1.2.5"
    dataset.PatientName, dataset.PatientID = "Muster^Erika", "4711"
    dataset.InstanceNumber, dataset.SeriesNumber, dataset.SeriesDescription = number + 1, 2, "thorax"
    dataset.ImagePositionPatient, dataset.ImageOrientationPatient = [-10, -20, 2 * number], [1, 0, 0, 0, 1, 0]
    dataset.PixelSpacing, dataset.SliceThickness = [0.5, 0.5], 2
    dataset.RescaleSlope, dataset.RescaleIntercept = 1, -1024
    dataset.Rows, dataset.Columns = plane.shape
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.BitsAllocated = dataset.BitsStored = 8 * plane.dtype.itemsize
    dataset.HighBit, dataset.PixelRepresentation = dataset.BitsStored - 1, 0
    dataset.PixelData = plane.astype(plane.dtype.newbyteorder(">" if syntax == BIG else "<")).tobytes()
    dataset["PixelData"].VR = "OW" if plane.dtype.itemsize > 1 else "OB"
    return dataset


def dicom(syntax: str = EXPLICIT, compress: str = "", name: str = "{}.dcm") -> Seed:
    """A DICOM series."""

    def write(folder: Path) -> Path:
        import pydicom
        from pydicom.encaps import encapsulate

        for number, plane in enumerate(BYTES if compress == JPEG else VALUES.astype(np.uint16)):
            dataset = ct_dataset(number, plane, syntax)
            if compress == JPEG:
                stream = io.BytesIO()
                Image.fromarray(plane).save(stream, "JPEG")
                dataset.PixelData = encapsulate([stream.getvalue()])
                dataset["PixelData"].VR, dataset["PixelData"].is_undefined_length = "OB", True
                dataset.file_meta.TransferSyntaxUID = JPEG
            elif compress:
                dataset.compress(compress, generate_instance_uid=False)
            pydicom.dcmwrite(folder / name.format(number), dataset, enforce_file_format=True)
        return folder

    return write


def enhanced_dicom(folder: Path) -> Path:
    """An enhanced CT: one file with functional groups."""
    import pydicom
    from pydicom.dataset import Dataset

    dataset = ct_dataset(0, VALUES[0].astype(np.uint16))
    kind = "1.2.840.10008.5.1.4.1.1.2.1"
    dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = kind
    dataset.NumberOfFrames = len(VALUES)
    dataset.PixelData = VALUES.astype(np.uint16).tobytes()
    shared = Dataset()
    for sequence, name in (
        ("PlaneOrientationSequence", "ImageOrientationPatient"),
        ("PixelMeasuresSequence", "PixelSpacing"),
    ):
        item = Dataset()
        setattr(item, name, getattr(dataset, name))
        setattr(shared, sequence, [item])
    frames = []
    for number in range(len(VALUES)):
        place, frame = Dataset(), Dataset()
        place.ImagePositionPatient = [0, 0, number]
        frame.PlanePositionSequence = [place]
        frames.append(frame)
    dataset.SharedFunctionalGroupsSequence, dataset.PerFrameFunctionalGroupsSequence = [shared], frames
    pydicom.dcmwrite(folder / "ct.dcm", dataset, enforce_file_format=True)
    return folder / "ct.dcm"


def segmentation(folder: Path) -> Path:
    """A DICOM SEG of two segments beside its CT."""
    import pydicom
    from pydicom.dataset import Dataset

    dicom(name="ct{}.dcm")(folder)
    enhanced_dicom(folder)
    dataset = pydicom.dcmread(folder / "ct.dcm")
    kind = "1.2.840.10008.5.1.4.1.1.66.4"
    dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = kind
    dataset.Modality, dataset.SegmentationType = "SEG", "BINARY"
    dataset.SeriesInstanceUID, dataset.SOPInstanceUID = "1.2.3.9", "1.2.3.9.1"
    dataset.BitsAllocated = dataset.BitsStored = 1
    dataset.HighBit = 0
    dataset.PixelData = np.packbits(VALUES.ravel() > 120, bitorder="little").tobytes()
    dataset["PixelData"].VR = "OB"
    dataset.SegmentSequence = []
    for number, label in ((1, "liver"), (2, "spleen")):
        segment = Dataset()
        segment.SegmentNumber, segment.SegmentLabel = number, label
        segment.RecommendedDisplayCIELabValue = [40000, 30000, 30000]
        dataset.SegmentSequence.append(segment)
    for number, frame in enumerate(dataset.PerFrameFunctionalGroupsSequence):
        which, source = Dataset(), Dataset()
        which.ReferencedSegmentNumber = 1 + number % 2
        frame.SegmentIdentificationSequence = [which]
        frame.PlanePositionSequence[0].ImagePositionPatient = [-10, -20, 2 * number]
        source.ReferencedSOPInstanceUID = f"1.2.3.{number + 1}"
    referenced = Dataset()
    referenced.SeriesInstanceUID = "1.2.3.4"
    dataset.ReferencedSeriesSequence = [referenced]
    pydicom.dcmwrite(folder / "seg.dcm", dataset, enforce_file_format=True)
    (folder / "ct.dcm").unlink()
    return folder / "seg.dcm"


def structures(folder: Path) -> Path:
    """An RTSTRUCT of one region beside its CT."""
    import pydicom

    dicom(name="ct{}.dcm")(folder)
    dataset = ct_dataset(20, VALUES[0].astype(np.uint16))
    kind = "1.2.840.10008.5.1.4.1.1.481.3"
    dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = kind
    dataset.Modality, dataset.SeriesInstanceUID = "RTSTRUCT", "1.2.3.8"
    for name in ("PixelData", "Rows", "Columns", "PixelSpacing", "ImagePositionPatient", "ImageOrientationPatient"):
        delattr(dataset, name)

    series = item(SeriesInstanceUID="1.2.3.4", ContourImageSequence=[item(ReferencedSOPInstanceUID="1.2.3.1")])
    study = item(RTReferencedSeriesSequence=[series], ReferencedSOPInstanceUID="1.2.3")
    dataset.ReferencedFrameOfReferenceSequence = [item(FrameOfReferenceUID="1.2.5", RTReferencedStudySequence=[study])]
    dataset.StructureSetROISequence = [item(ROINumber=1, ROIName="GTV", ReferencedFrameOfReferenceUID="1.2.5")]
    contours = [
        item(
            ContourGeometricType="CLOSED_PLANAR",
            NumberOfContourPoints=4,
            ContourData=[-8, -18, 2 * z, 2, -18, 2 * z, 2, -8, 2 * z, -8, -8, 2 * z],
            ContourImageSequence=[item(ReferencedSOPInstanceUID=f"1.2.3.{z + 1}")],
        )
        for z in range(4)
    ]
    dataset.ROIContourSequence = [item(ReferencedROINumber=1, ROIDisplayColor=[255, 0, 0], ContourSequence=contours)]
    pydicom.dcmwrite(folder / "rs.dcm", dataset, enforce_file_format=True)
    return folder / "rs.dcm"


def dose(folder: Path) -> Path:
    """An RTDOSE whose frames lie 2 mm apart."""
    write_dose(folder / "dose.dcm", VALUES.astype(np.uint16), [0, 2, 4, 6])
    return folder / "dose.dcm"


def pet(units: str) -> Seed:
    """A PET of FDG; values in Bq/ml are decayed to the start of the scan, counts scaled by Philips' private factor."""

    def write(folder: Path) -> Path:
        import pydicom

        for number, plane in enumerate(VALUES.astype(np.uint16)):
            dataset = ct_dataset(number, plane)
            dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = PET
            dataset.Modality, dataset.Units, dataset.RescaleSlope, dataset.RescaleIntercept = "PT", units, 2 + number, 0
            dataset.SeriesDate = dataset.AcquisitionDate = "20240305"
            dataset.SeriesTime, dataset.AcquisitionTime = "100000", f"1{number}0000"
            dataset.CorrectedImage, dataset.DecayCorrection, dataset.PatientWeight = ["ATTN", "DECY"], "START", 70
            dataset.FrameReferenceTime, dataset.ActualFrameDuration = 3600000 * number, 60000
            dataset.RadiopharmaceuticalInformationSequence = [
                item(RadiopharmaceuticalStartTime="090000.00", RadionuclideTotalDose=3.5e8, RadionuclideHalfLife=6586.2)
            ]
            if units == "CNTS":
                dataset.add_new((0x7053, 0x0010), "LO", "Philips PET Private Group")
                dataset.add_new((0x7053, 0x1000), "DS", "0.25")
            pydicom.dcmwrite(folder / f"{number}.dcm", dataset, enforce_file_format=True)
        return folder

    return write


def dicomdir(folder: Path) -> Path:
    """A DICOMDIR, which is not read itself: its folder is."""
    dicom(name="IM{}")(folder)
    (folder / "DICOMDIR").write_bytes((folder / "IM0").read_bytes()[:600])
    return folder / "DICOMDIR"
