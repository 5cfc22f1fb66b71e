# SPDX-License-Identifier: GPL-3.0-or-later
"""What a second reader makes of an input that was accepted: tifffile, nibabel, pydicom, pynrrd or NumPy.

A peer that refuses says nothing. Where both read, values and geometry are the same, or a note says why not; each thing
that a peer rightly does in another way stands here with its reason.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ctmc_addon.core.volume import Volume
from ctmc_addon.readers.file_formats import natural_key

TOLERANCE = 2e-6  # of the largest number that takes part: values are scaled in float32 here, in float64 there
SMALLEST = 1e-37  # below it float32 loses digits
GEOMETRY = 1e-4  # mm, and of the largest number of an affine


class Peer(NamedTuple):
    """What the second reader has."""

    values: Any  # (slices, rows, columns)
    affine: Any = None  # to RAS mm
    spacing: Any = None  # mm along x, y and z, where there is no orientation
    scale: float = 0.0  # the largest number that took part in working the values out


class NotComparedError(Exception):
    """The peer reads something else by right; its text is the reason."""


# Notes that tell of values or a geometry other than the file's own, or of slices that were left out.
EXPLAINING = (
    "left out",
    "padding",
    "not applied",
    "were converted to mm",  # lengths; a peer gives them in the file's unit
    "has no name",
    "the later one keeps",
    "renumbered",
    "time points found",
    "acquisitions",
    "channels: the first was read",
    "no orientation",
    "tilt",
    "uneven",
    "grid",
    "duplicate",
    "NaN",
    "not a number",
    "resampled",
)

CHANGING = (
    "padding",
    "not applied",
    "the later one keeps",
    "NaN",
    "resampled",
)  # of these, values other than those stored


def disagreement(path: Path, volume: Volume) -> str:
    """How a second reader differs from what was read; empty where it agrees, '?' and why where there is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            peer = peer_of(path, volume)
        except NotComparedError as error:
            return f"?{error}"
        except MemoryError:
            return "?memory"
        except Exception as error:  # noqa: BLE001  (a peer may refuse in any way)
            return f"?{type(error).__name__}"
    if peer is None:
        return "?no peer"
    with np.errstate(all="ignore"):
        return difference(peer, volume)


def difference(peer: Peer, volume: Volume) -> str:
    """The first thing in which they differ."""
    values = volume.values
    explained = [text for text in EXPLAINING if any(text in note for note in volume.notes)]
    if peer.values.shape != values.shape:
        slices_left_out = any("left out" in note or "resampled" in note for note in volume.notes)
        return "" if slices_left_out else f"shape: {values.shape} here, {peer.values.shape} there"
    there = np.asarray(peer.values)
    if there.dtype == bool:
        there = there.astype(np.uint8)
    if values.dtype.kind in "iu" and there.dtype.kind in "iu":
        same = values == there
    else:
        finite = np.abs(there[np.isfinite(there)])
        reach = max(float(finite.max(initial=0.0)), peer.scale)
        here64, there64 = values.astype(np.float64), there.astype(np.float64)
        same = np.abs(here64 - there64) <= max(TOLERANCE * reach, SMALLEST)
        same |= (here64 == there64) | (np.isnan(here64) & np.isnan(there64))
    wrong = np.argwhere(~same)
    if len(wrong) and not any(text in explained for text in CHANGING):
        at = tuple(int(number) for number in wrong[0])
        return f"values: {len(wrong)} differ, at {at} {values[at]} here, {there[at]} there"
    if peer.affine is not None and not any(text in explained for text in ("converted", "no orientation", "no name")):
        reach = max(1.0, float(np.abs(peer.affine).max()))
        if not np.allclose(volume.affine, peer.affine, rtol=0, atol=GEOMETRY * reach):
            return f"affine: {volume.affine[:3].tolist()} here, {np.asarray(peer.affine)[:3].tolist()} there"
    converted = "were converted to mm" in explained
    if peer.spacing is not None and not converted and not np.allclose(volume.spacing, peer.spacing, GEOMETRY, 0):
        return f"spacing: {volume.spacing} here, {tuple(peer.spacing)} there"
    return ""


def peer_of(path: Path, volume: Volume) -> Peer | None:
    """What the peer for this kind of file reads, None where there is none."""
    kind = volume_kind(path)
    return PEERS[kind](path, volume) if kind else None


def volume_kind(path: Path) -> str:
    """Which peer reads the path; empty for none."""
    if path.suffix == ".zarr":
        return "zarr"
    if path.is_dir() or path.name == "DICOMDIR":
        folder = path if path.is_dir() else path.parent
        ends = {each.suffix.lower() for each in folder.iterdir()}
        if ends == {".tif"}:
            return "tiff" if len(list(folder.iterdir())) == 1 else "tiff folder"
        return "dicom" if ends <= {".dcm", ""} else ""
    name = path.name.lower()
    if name.endswith((".nii", ".nii.gz", ".hdr", ".img", ".mgh", ".mgz")):
        return "nibabel"
    if name.endswith((".nrrd", ".nhdr")):
        return "nrrd"
    ends = {".tif": "tiff", ".npy": "npy", ".dcm": "dicom"}
    return ends.get(path.suffix.lower(), "")


def by_numpy(path: Path, _volume: Volume) -> Peer:
    """NumPy's own file."""
    return Peer(np.load(path, allow_pickle=False))


def by_nibabel(path: Path, volume: Volume) -> Peer:
    """NIfTI, Analyze and MGH."""
    import nibabel

    image = nibabel.load(path)
    raw = np.asarray(image.dataobj)
    if raw.dtype.names:
        raise NotComparedError("colors are gray here where their channels are equal")
    values = np.asarray(raw)
    while values.ndim > 3:  # the first time
        values = values[..., 0]
    slope, inter = getattr(image.dataobj, "slope", 1.0), getattr(image.dataobj, "inter", 0.0)
    unscaled = np.asarray(image.dataobj.get_unscaled())
    finite = np.abs(unscaled[np.isfinite(unscaled)].astype(np.float64)).max(initial=0.0) * abs(slope)
    scale = max(float(finite), abs(float(inter)))
    kind = type(image).__name__
    zooms = tuple(float(zoom) for zoom in image.header.get_zooms()[:3])
    if kind.startswith("Nifti"):
        codes = int(image.header["qform_code"]), int(image.header["sform_code"])
        if image.header.get_xyzt_units()[0] not in ("mm", "unknown"):
            raise NotComparedError("nibabel keeps the file's unit")
        if codes == (0, 0):  # nibabel centers the volume and turns x over, which no reader agrees on
            return Peer(values.T, None, zooms, scale)
    if kind in ("Spm2AnalyzeImage", "Spm99AnalyzeImage", "AnalyzeImage"):
        return Peer(values.T, None, None, scale)  # spacing may be negative, or 0 for 1
    return Peer(values.T, image.affine, None, scale)


def by_pynrrd(path: Path, volume: Volume) -> Peer:
    """NRRD."""
    import nrrd

    with path.open("rb") as file:
        if not b"".join(iter(lambda: file.readline(1 << 16).strip(b"\r\n"), b"")).isascii():
            raise NotComparedError("pynrrd counts too few bytes of a header that is not ASCII")
    values, header = nrrd.read(str(path), index_order="C")
    if any(key.startswith("Segment") for key in header) and values.ndim > 3:
        raise NotComparedError("layers of segments become one label volume")
    while values.ndim > 3:
        kinds = header.get("kinds") or []
        if kinds and kinds[-1] not in ("domain", "space"):
            values = values[0]  # times last in the file's order
        else:
            raise NotComparedError("layers or components")
    directions, space = header.get("space directions"), str(header.get("space", "")).lower()
    if header.get("space units") not in (None, ["mm"] * 3):
        raise NotComparedError("pynrrd keeps the file's unit")
    signs = {
        "left-posterior-superior": (-1, -1, 1),
        "lps": (-1, -1, 1),
        "right-anterior-superior": (1, 1, 1),
        "ras": (1, 1, 1),
        "left-anterior-superior": (-1, 1, 1),
        "las": (-1, 1, 1),
    }.get(space)
    if directions is None or signs is None or np.asarray(directions).shape != (3, 3):
        return Peer(values)
    affine = np.eye(4)
    affine[:3, :3] = np.asarray(directions).T
    affine[:3, 3] = header.get("space origin", np.zeros(3))
    affine[:3] *= np.array(signs)[:, None]
    return Peer(values, affine)


def wants_imagecodecs(error: BaseException) -> bool:
    """Whether tifffile cannot decode this by itself."""
    return isinstance(error, NotImplementedError) or "imagecodecs" in str(error)


def tiff_pages(path: Path) -> Any:
    """Gray values of all pages (pages, rows, columns), by tifffile where it can decode them, else by Pillow."""
    import tifffile
    from PIL import Image

    with tifffile.TiffFile(path, _multifile=False) as tiff:
        first = tiff.pages[0]
        photometric, bits = int(first.photometric), first.bitspersample
        if first.predictor != 1 and bits not in (8, 16, 32, 64):
            raise NotComparedError(
                "imagecodecs does not begin at 0 again after the largest number, and Pillow adds nothing"
            )
        try:
            planes = [(page if page.offset <= 0 else page.aspage()).asarray() for page in tiff.pages]
            planes = [np.stack([plane])[0] for plane in planes]
        except (ValueError, NotImplementedError) as error:
            if not wants_imagecodecs(error):
                raise
            planes = []
        if not planes:
            with Image.open(path) as image:
                for number in range(image.n_frames):
                    image.seek(number)
                    if image.mode not in ("1", "L", "I;16", "I;16B", "F", "I"):
                        raise NotComparedError(f"Pillow's type {image.mode}")
                    if int(image.tag_v2[258][0]) != bits:
                        raise NotComparedError("pages of different bits")
                    plane = np.asarray(image)
                    if bits in (2, 4):  # Pillow spreads them over 8 bits
                        plane = plane // (255 // ((1 << bits) - 1))
                    planes.append(plane.astype(np.uint8) * 255 if bits == 1 else plane)
            return np.stack(planes)  # Pillow turns white over itself
        made = []
        for page, plane in zip(tiff.pages, planes, strict=True):
            key = page.keyframe
            if int(key.photometric) != photometric:
                raise NotComparedError("pages of different kinds")
            if photometric == 3:
                colors = key.colormap >> 8 if key.colormap.max() > 255 else key.colormap
                plane = colors[0][plane.astype(int)]
            elif plane.dtype == bool:
                plane = (plane != (photometric == 0)) * np.uint8(255)
            elif photometric == 0 and plane.dtype.kind == "u":
                plane = (1 << bits) - 1 - plane
            if plane.ndim == 3:
                plane = plane[0] if int(key.planarconfig) == 2 else plane[..., 0]
            made.append(plane)
        return np.stack(made)


def by_tifffile(path: Path, volume: Volume) -> Peer:
    """TIFF of several pages: all pages in the file's order, or those of the first time and channel."""
    import tifffile

    if path.is_dir():
        (path,) = path.iterdir()

    with tifffile.TiffFile(path, _multifile=False) as tiff:
        series, photometric = tiff.series[0], int(tiff.pages[0].photometric)
        if len(tiff.pages) == 1 and math.prod(series.shape[:-2]) == 1:
            return by_tifffile_of_folder(path.parent, volume)
        plain = photometric == 1 and tiff.pages[0].predictor == 1
        if len(tiff.series) == 1 and plain and set("YX") < set(series.axes):
            several = sum(side > 1 for axis, side in zip(series.axes, series.shape, strict=True) if axis not in "YX")
            first_of = "TC" if several > 1 else ""
            try:
                values = series.asarray()[tuple(0 if axis in first_of else slice(None) for axis in series.axes)]
            except (ValueError, NotImplementedError) as error:
                if not wants_imagecodecs(error):
                    raise
                return Peer(tiff_pages(path))
            if values.dtype == bool:
                values = values * np.uint8(255)
            about = tiff.imagej_metadata or {}
            if about.get("cf") == 0 and values.dtype.kind == "u" and values.dtype.itemsize < 4:
                values = values * float(about["c1"]) + float(about["c0"])
            return Peer(values.reshape(-1, *values.shape[-2:]))
    return Peer(tiff_pages(path))


def by_tifffile_of_folder(path: Path, _volume: Volume) -> Peer:
    """TIFF slices, one page each."""
    files = sorted((each for each in path.iterdir() if not each.name.startswith(".")), key=natural_key)
    return Peer(np.concatenate([tiff_pages(each) for each in files]))


def by_zarr(path: Path, _volume: Volume) -> Peer:
    """The first array that an OME-Zarr names, and its scale."""
    import zarr

    group = zarr.open_group(path, mode="r")
    about = group.attrs.get("ome", group.attrs)
    first = about["multiscales"][0]["datasets"][0]
    scale = first["coordinateTransformations"][0]["scale"]
    if any(axis.get("unit") != "millimeter" for axis in about["multiscales"][0]["axes"]):
        raise NotComparedError("zarr knows no unit")
    return Peer(np.asarray(group[first["path"]]), None, tuple(reversed(scale)))


def by_pydicom_of_dose(dataset: Any) -> Peer:
    """A dose whose frames ascend evenly from its position."""
    offsets, (x, y) = (
        np.array(dataset.GridFrameOffsetVector, float),
        np.array(dataset.ImageOrientationPatient, float).reshape(2, 3),
    )
    if offsets[0] != 0 or not np.allclose(np.diff(offsets), offsets[1]) or offsets[1] <= 0:
        raise NotComparedError("frames of a dose in an order or at a place of their own")
    row_mm, column_mm = (float(number) for number in dataset.PixelSpacing)
    affine = np.eye(4)
    affine[:3, 0], affine[:3, 1], affine[:3, 2] = x * column_mm, y * row_mm, np.cross(x, y) * offsets[1]
    affine[:3, 3] = dataset.ImagePositionPatient
    affine[:2] *= -1  # LPS to RAS
    stored = dataset.pixel_array[: int(dataset.NumberOfFrames)]  # pydicom returns more where there are bytes for them.
    return Peer(stored * float(dataset.DoseGridScaling), affine)


def by_pydicom(path: Path, volume: Volume) -> Peer:
    """DICOM slices of one series, in order of position along the normal; frames of an enhanced one as they are."""
    import pydicom

    folder = path if path.is_dir() else path.parent
    datasets = []
    for each in sorted(folder.iterdir()):
        if each.name == "DICOMDIR":
            continue
        try:
            datasets.append(pydicom.dcmread(each))
        except pydicom.errors.InvalidDicomError as error:
            raise NotComparedError("a file that is not DICOM among them") from error
    kinds = {str(dataset.get("SeriesInstanceUID", "")) for dataset in datasets}
    if len(kinds) > 1 or volume.kind == "label":
        raise NotComparedError("several series, or labels made of segments")
    modality = datasets[0].get("Modality") if datasets else None
    if modality == "RTDOSE" and len(datasets) == 1:
        return by_pydicom_of_dose(datasets[0])
    if modality == "PT" and any(dataset.get("Units") != "BQML" for dataset in datasets):
        raise NotComparedError("counts have a private factor for each slice")
    planes, places, scale = [], [], 0.0
    for dataset in datasets:
        if "PixelPaddingValue" in dataset or "ModalityLUTSequence" in dataset:
            raise NotComparedError("padding and tables are applied here")
        if dataset.get("PhotometricInterpretation") not in ("MONOCHROME1", "MONOCHROME2"):
            raise NotComparedError("colors are gray here where their channels are equal")
        if dataset.get("PerFrameFunctionalGroupsSequence"):
            raise NotComparedError("frames carry positions and rescaling of their own")
        stored = dataset.pixel_array
        slope, intercept = float(dataset.get("RescaleSlope", 1)), float(dataset.get("RescaleIntercept", 0))
        if stored.ndim != 2:
            raise NotComparedError("frames")
        scale = max(scale, abs(intercept), float(np.abs(stored.astype(np.float64)).max()) * abs(slope))
        planes.append(stored.astype(np.float64) * slope + intercept)
        x, y = np.array(dataset.ImageOrientationPatient, float).reshape(2, 3)
        places.append((dataset, x, y, np.array(dataset.ImagePositionPatient, float)))
    _, x, y, _ = places[0]
    normal = np.cross(x, y)
    along = np.array([place @ normal for *_, place in places])
    order = np.argsort(along, kind="stable")
    if len(set(np.round(along, 6))) < len(along):
        raise NotComparedError("slices at one place")
    first, last = places[order[0]], places[order[-1]]
    row_mm, column_mm = (float(number) for number in first[0].PixelSpacing)
    affine = np.eye(4)
    affine[:3, 0], affine[:3, 1] = x * column_mm, y * row_mm
    affine[:3, 2] = (last[3] - first[3]) / max(1, len(planes) - 1)
    affine[:3, 3] = first[3]
    affine[:2] *= -1  # LPS to RAS
    even = np.allclose(np.diff(along[order]), np.diff(along[order]).mean(), atol=1e-3)
    unit = math.isclose(float(x @ x), 1, abs_tol=1e-4) and math.isclose(float(y @ y), 1, abs_tol=1e-4)
    straight = unit and np.allclose(np.cross(affine[:3, 2], normal * (-1, -1, 1)), 0, atol=1e-3)
    values = np.stack([planes[number] for number in order])
    if modality == "PT" and values.shape == volume.values.shape:  # SUVbw is activity times one factor.
        values, scale = values * (volume.values.max() / values.max()), 0.0
    return Peer(values, affine if even and straight else None, None, scale)


PEERS = {
    "npy": by_numpy,
    "nibabel": by_nibabel,
    "nrrd": by_pynrrd,
    "tiff": by_tifffile,
    "tiff folder": by_tifffile_of_folder,
    "dicom": by_pydicom,
    "zarr": by_zarr,
}
