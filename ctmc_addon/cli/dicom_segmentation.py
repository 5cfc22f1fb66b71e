# SPDX-License-Identifier: GPL-3.0-or-later
"""Write structures as a DICOM segmentation of the CT they were made on, through highdicom.

DICOM wants the patient and the study of the source in every object that is derived from it (PS3.3 A.51, C.7.1.1), so
this is the only file of `ctmc` that carries an identity, and it is written only where that is asked for.
"""

from __future__ import annotations

import hashlib
import importlib
import math
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import Budget, OutputError
from ..core.files.file_names import printable
from ..core.files.label_files import Segment
from ..core.segmentation import Layers
from ..core.volume import anatomy_of, product
from ..readers import ReadingOptions, VolumeSource
from ..version import VERSION

SUFFIX = ".dcm"
EXTRA = "pip install 'ctmc-addon[dicom-seg]'"
OLDEST = [0, 27]  # Since this version colors are made from sRGB.
SERIES_NUMBER = 900  # Scanners use smaller numbers.
ANATOMY = ("123037004", "SCT", "Anatomical Structure")  # From PS3.16 CID 7150.
ABNORMAL = ("49755003", "SCT", "Morphologically Abnormal Structure")
TISSUE, LESION = ("85756007", "SCT", "Tissue"), ("52988006", "SCT", "Lesion")
FAMILY = ("123101", "DCM", "Neighborhood Analysis")  # From PS3.16 CID 7162.
IDENTITY = (  # Type 2 of PS3.3 C.7.1.1 and C.7.2.1: present, perhaps empty; anonymized files lack some.
    *("PatientID", "PatientName", "PatientBirthDate", "PatientSex"),
    *("AccessionNumber", "StudyID", "StudyDate", "StudyTime"),
)

NEEDED = ("SOPClassUID", "SOPInstanceUID", "StudyInstanceUID", "SeriesInstanceUID", "FrameOfReferenceUID")

COPIES = 3  # The number of copies of the masks that highdicom makes, of a byte per voxel.


def require_highdicom() -> Any:
    """Import highdicom; if it is missing, raise an `OutputError` with the command that installs it."""
    try:
        highdicom = importlib.import_module("highdicom")
    except ImportError as error:
        raise OutputError(
            f"a DICOM segmentation needs the Python package highdicom, which is missing; {EXTRA}, or write a .seg.nrrd"
        ) from error
    version = str(getattr(highdicom, "__version__", "unknown"))
    if [int(part) for part in re.findall(r"\d+", version)[:2]] < OLDEST:
        raise OutputError(
            f"a DICOM segmentation needs highdicom {'.'.join(map(str, OLDEST))} or newer, not {version}; "
            f"{EXTRA}, or write a .seg.nrrd"
        )
    return highdicom


def images_of(source: VolumeSource, options: ReadingOptions) -> list[Path]:
    """Return the DICOM images that a CT is read from; an `OutputError` where the CT is another format."""
    images = source.images_read(options)
    if images:
        return images
    raise OutputError(
        f"a DICOM segmentation must refer to DICOM images, and {source.path.name} is {source.format}; write a .seg.nrrd"
    )


def write(path: Path, layers: Layers, segments: list[Segment], affine: NDArray[np.float64], images: list[Path]) -> None:
    """Write structures as a DICOM segmentation, with the patient and study of its images.

    Parameters
    ----------
    path : Path
    layers : Layers
    segments : list of Segment
        In the order of the layers' labels, numbered 1, 2, 3 and so on.
    affine : (4, 4) float64
        Index (x, y, z) to RAS+ mm.
    images : list of Path
        The DICOM images of the CT.

    Raises
    ------
    OutputError
        If highdicom is missing, or the images lack what a segmentation must repeat.
    MemoryLimitError
        If there is not enough memory: highdicom takes a byte a voxel for each structure, and a copy.
    """
    highdicom = require_highdicom()
    pydicom = importlib.import_module("pydicom")
    with warnings.catch_warnings():  # warnings of either library do not concern the user
        warnings.simplefilter("ignore")
        headers = [pydicom.dcmread(image, stop_before_pixels=True) for image in images]
        for header in headers:
            missing = [keyword for keyword in NEEDED if not header.get(keyword)]
            if missing:
                raise OutputError(
                    f"the CT's DICOM images lack {', '.join(missing)}, which a segmentation refers "
                    "to; write a .seg.nrrd"
                )
            # Some anonymizers gave every slice a frame of reference of its own; one volume has one.
            header.FrameOfReferenceUID = headers[0].FrameOfReferenceUID
            for keyword in IDENTITY:
                if keyword not in header:
                    setattr(header, keyword, "")
        needed = COPIES * len(segments) * math.prod(layers.shape)
        Budget().require(needed, "a DICOM segmentation", "write a .seg.nrrd, which needs one byte per voxel")
        masks = np.empty((*layers.shape, len(segments)), np.uint8)
        content = hashlib.sha256(headers[0].SeriesInstanceUID.encode())
        for segment, label in zip(segments, layers.layer_of, strict=True):
            mask = layers.mask(label)
            masks[..., segment.label - 1] = mask
            content.update(segment.name.encode() + np.packbits(mask).tobytes())
        uids = [pydicom.uid.generate_uid(entropy_srcs=[content.hexdigest(), word]) for word in ("series", "object")]
        try:
            segmentation = highdicom.seg.Segmentation(
                headers,
                _volume(highdicom, masks, affine, headers[0].FrameOfReferenceUID),
                highdicom.seg.SegmentationTypeValues.BINARY,
                [_description(highdicom, segment) for segment in segments],
                series_instance_uid=uids[0],
                series_number=SERIES_NUMBER,
                sop_instance_uid=uids[1],
                instance_number=1,
                manufacturer="CTMC",
                manufacturer_model_name="ctmc segment",
                software_versions=VERSION,
                device_serial_number="none",
                content_label="SEGMENTATION",
                series_description="Segmentation",
            )
            segmentation.save_as(path)
        except ValueError as error:  # highdicom's own words for such images
            raise OutputError(
                f"no DICOM segmentation can be made from the CT's images ({error}); write a .seg.nrrd"
            ) from error


def _volume(highdicom: Any, masks: NDArray[np.uint8], affine: NDArray[np.float64], frame: str) -> Any:
    """Return the masks as highdicom's volume: (slice, row, column, structure), index to LPS+ mm."""
    to_lps = product(np.diag([-1.0, -1.0, 1.0, 1.0]), affine)
    return highdicom.Volume(
        array=masks,
        affine=to_lps[:, [2, 1, 0, 3]],
        coordinate_system="PATIENT",
        frame_of_reference_uid=frame,
        channels={"SegmentNumber": list(range(1, masks.shape[-1] + 1))},
    )


def _description(highdicom: Any, segment: Segment) -> Any:
    """Return a structure's description for viewers: its name, its color and whether it is a lesion."""
    coded = highdicom.sr.CodedConcept
    lesion = anatomy_of(segment.name) == anatomy_of("tumor")
    return highdicom.seg.SegmentDescription(
        segment_number=segment.label,
        segment_label=printable(segment.name).replace("\\", "/")[:64],  # a long string of DICOM, PS3.5 6.2
        segmented_property_category=coded(*(ABNORMAL if lesion else ANATOMY)),
        segmented_property_type=coded(*(LESION if lesion else TISSUE)),
        algorithm_type=highdicom.seg.SegmentAlgorithmTypeValues.SEMIAUTOMATIC,
        algorithm_identification=highdicom.AlgorithmIdentificationSequence(
            name="ctmc segment", version=VERSION, family=coded(*FAMILY)
        ),
        display_color=highdicom.color.CIELabColor.from_rgb(*segment.color),
    )
