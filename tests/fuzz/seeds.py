# SPDX-License-Identifier: GPL-3.0-or-later
"""One small whole file or folder of every format that is read, made by code."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import tifffile
import zarr_stores
from hand_made_tiff import DEFLATE, LZW, NONE, PACKBITS, gray_page, tiff
from PIL import Image

from .dicom_seeds import (
    BIG,
    DEFLATED,
    IMPLICIT,
    J2K,
    JPEG,
    RLE,
    dicom,
    dicomdir,
    dose,
    enhanced_dicom,
    pet,
    segmentation,
    structures,
)
from .seed_values import BYTES, VALUES, Seed


def nifti(name: str, second: bool = False, dtype: Any = np.int16) -> Seed:
    """NIfTI in one file."""

    def write(folder: Path) -> Path:
        kind = nibabel.Nifti2Image if second else nibabel.Nifti1Image
        nibabel.save(kind(VALUES.T.astype(dtype), np.diag([-0.5, -0.5, 2, 1])), folder / name)
        return folder / name

    return write


def nibabel_file(kind: str, name: str) -> Seed:
    """MGH or Analyze."""

    def write(folder: Path) -> Path:
        nibabel.save(getattr(nibabel, kind)(VALUES.T, np.eye(4)), folder / name)
        return folder / name

    return write


def nrrd_file(encoding: str) -> Seed:
    """NRRD with its values."""

    def write(folder: Path) -> Path:
        header = {"space": "LPS", "space directions": np.diag([0.5, 0.5, 2]), "space origin": np.zeros(3)}
        header |= {"encoding": encoding, "Segment0_LabelValue": "1", "Segment0_Name": "liver"}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            nrrd.write(str(folder / "ct.nrrd"), VALUES.T, header)
        return folder / "ct.nrrd"

    return write


def detached_nrrd(folder: Path) -> Path:
    """A header with a file for each slice."""
    for number, plane in enumerate(VALUES):
        (folder / f"s{number}.raw").write_bytes(plane.tobytes())
    header = "NRRD0004\ntype: short\ndimension: 3\nsizes: 40 34 4\nendian: little\nencoding: raw\n"
    (folder / "ct.nhdr").write_text(
        header + "space directions: (1,0,0) (0,1,0) (0,0,2)\nspace: LPS\n"
        "byte skip: 0\nline skip: 0\ndata file: s%d.raw 0 3 1\n\n"
    )
    return folder / "ct.nhdr"


def metaimage(name: str, compressed: bool = False) -> Seed:
    """MetaImage, its values within or beside."""

    def write(folder: Path) -> Path:
        import zlib

        content = zlib.compress(VALUES.tobytes()) if compressed else VALUES.tobytes()
        data = "LOCAL" if name.endswith(".mha") else "ct.zraw" if compressed else "ct.raw"
        head = (
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
            f"CompressedData = {compressed}\nCompressedDataSize = {len(content)}\n"
            "TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\nElementSpacing = 0.5 0.5 2\nDimSize = 40 34 4\n"
            f"ElementType = MET_SHORT\nElementDataFile = {data}\n"
        )
        if data != "LOCAL":
            (folder / data).write_bytes(content)
        (folder / name).write_bytes(head.encode() + (content if data == "LOCAL" else b""))
        return folder / name

    return write


def npy(folder: Path) -> Path:
    """NumPy."""
    np.save(folder / "ct.npy", VALUES)
    return folder / "ct.npy"


def pictures(suffix: str, mode: str = "L", **options: Any) -> Seed:
    """A folder of pictures by Pillow."""

    def write(folder: Path) -> Path:
        for number, plane in enumerate(VALUES):
            image = Image.fromarray(plane.astype(np.uint16) * 200) if mode == "I;16" else Image.fromarray(BYTES[number])
            if mode in ("P", "RGB", "RGBA", "LA", "1"):
                image = image.convert(mode)
            image.save(folder / f"s{number}.{suffix}", **options)
        return folder

    return write


def tiff_pages(**options: Any) -> Seed:
    """A TIFF of several pages by tifffile."""

    def write(folder: Path) -> Path:
        values = BYTES if options.pop("bytes", False) else VALUES
        if options.get("imagej") or options.get("ome"):
            options["metadata"] = {"axes": "ZYX", "spacing": 2.0, "unit": "um"}
        tifffile.imwrite(folder / "ct.tif", values, photometric="minisblack", **options)
        return folder / "ct.tif"

    return write


def tiff_calibrated(folder: Path) -> Path:
    """A TIFF of ImageJ, whose unsigned numbers a straight line makes HU."""
    about = {"axes": "ZYX", "cf": 0, "c0": -32768.0, "c1": 1.0, "vunit": "Gray Value"}
    stored = (VALUES.astype(np.int32) + 32768).astype(np.uint16)
    tifffile.imwrite(folder / "ct.tif", stored, imagej=True, metadata=about)
    return folder / "ct.tif"


def tiff_of_bits(bits: int, compression: int = NONE, palette: bool = False, **options: Any) -> Seed:
    """A TIFF of several pages with samples of so many bits, or with a palette of gray."""

    def write(folder: Path) -> Path:
        more: dict[str, Any] = {}
        if palette:
            shades = [int(shade) for shade in np.linspace(0, 65535, 1 << bits)]
            more = {"t262": (3, [3]), "t320": (3, shades * 3)}
        planes = VALUES.astype(int) * 16 % (1 << bits) if bits > 8 else VALUES.astype(int) % (1 << bits)
        pages = [gray_page(plane, bits, compression, 10, **options, **more) for plane in planes]
        (folder / "ct.tif").write_bytes(tiff(pages))
        return folder / "ct.tif"

    return write


def tiff_by_pillow(compression: str) -> Seed:
    """A TIFF of several pages by Pillow."""

    def write(folder: Path) -> Path:
        first, *others = (Image.fromarray(plane) for plane in BYTES)
        first.save(folder / "ct.tif", save_all=True, append_images=others, compression=compression)
        return folder / "ct.tif"

    return write


def masks(folder: Path) -> Path:
    """A folder of masks, one NIfTI for each organ."""
    for label, name in enumerate(("liver", "spleen", "kidney_left")):
        values = (label == VALUES.T % 5).astype(np.uint8)
        nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), folder / f"{name}.nii.gz")
    return folder


def vff(folder: Path) -> Path:
    """VFF with a scale."""
    header = "ncaa\nrank=3;\nbits=16;\nbands=1;\nsize=40 34 4;\nspacing=1 1 2;\nelementsize=0.5;\ndata_scale=2;\n\f\n"
    (folder / "ct.vff").write_bytes(header.encode() + VALUES.astype(">i2").tobytes())
    return folder / "ct.vff"


def flat_pair(name: str) -> Seed:
    """The text of Volume Graphics or PyHST, and its values."""
    texts = {
        "ct.vgi": "[file1]\nFileFormat = raw\nSize = 40 34 4\nName = ct.vol\nDatatype = signed integer\n"
        "BitsPerElement = 16\n[geometry]\nresolution = 0.5 0.5 2\nunit = mm\n",
        "ct.vol.info": "NUM_X = 40\nNUM_Y = 34\nNUM_Z = 4\nvoxelSize = 5\nDATA_TYPE = int16\n",
    }

    def write(folder: Path) -> Path:
        (folder / name).write_text(texts[name])
        (folder / "ct.vol").write_bytes(VALUES.astype("<i2").tobytes())
        return folder / name

    return write


def zarr_store(version: str) -> Seed:
    """An OME-Zarr of two levels and several chunks."""

    def write(folder: Path) -> Path:
        return zarr_stores.save_store(folder / "ct.zarr", VALUES, version, levels=2, chunks=(2, 20, 20))

    return write


def surface(name: str) -> Seed:
    """Triangles of a tetrahedron, as binary or text; the PLY has a polygon of four corners and a color beside them."""
    corners = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3]], np.float32)
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]

    def write(folder: Path) -> Path:
        if name == "text.stl":
            facets = ("vertex {} {} {}\n".format(*corners[vertex]) for face in faces for vertex in face)
            (folder / name).write_text("solid a\n" + "".join(facets) + "endsolid a\n")
        elif name == "binary.stl":
            rows = b"".join(bytes(12) + corners[list(face)].tobytes() + bytes(2) for face in faces)
            (folder / name).write_bytes(bytes(80) + len(faces).to_bytes(4, "little") + rows)
        else:
            form = "ascii" if name == "text.ply" else "binary_big_endian"
            head = f"ply\nformat {form} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
            head += "property uchar red\nelement face 5\nproperty list uchar int vertex_indices\nend_header\n"
            polygons = [*faces, (0, 1, 2, 3)]
            if form == "ascii":
                body = "".join("{} {} {} 9\n".format(*corner) for corner in corners).encode()
                body += "".join(f"{len(each)} {' '.join(map(str, each))}\n" for each in polygons).encode()
            else:
                body = b"".join(corner.astype(">f4").tobytes() + b"\t" for corner in corners)
                body += b"".join(bytes([len(each)]) + np.array(each, ">i4").tobytes() for each in polygons)
            (folder / name).write_bytes(head.encode() + body)
        return folder / name

    return write


def times(folder: Path) -> Path:
    """NIfTI with a fourth dimension."""
    values = np.stack([VALUES.T, VALUES.T + 1], axis=-1)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), folder / "ct.nii.gz")
    return folder / "ct.nii.gz"


def nifti_pair(folder: Path) -> Path:
    """NIfTI in two files."""
    nibabel.save(nibabel.Nifti1Pair(VALUES.T, np.eye(4)), folder / "ct.img")
    return folder / "ct.hdr"


def segment_layers(folder: Path) -> Path:
    """A NRRD of 3D Slicer's, whose segments overlap in two layers."""
    header = {"space": "LPS", "space directions": np.vstack([np.full(3, np.nan), np.diag([0.5, 0.5, 2])])}
    header |= {"space origin": np.zeros(3), "kinds": ["list", "domain", "domain", "domain"], "encoding": "gzip"}
    for number in range(2):
        fields = {"LabelValue": 1, "Layer": number, "Name": f"part {number}", "Color": "0.5 0.2 1"}
        header |= {f"Segment{number}_{key}": str(value) for key, value in fields.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        nrrd.write(str(folder / "x.seg.nrrd"), np.stack([BYTES.T > 100, BYTES.T % 2]).astype(np.uint8), header)
    return folder / "x.seg.nrrd"


def label_table(folder: Path) -> Path:
    """Labels with a table of names beside them."""
    nibabel.save(nibabel.Nifti1Image(BYTES.T % 3, np.eye(4)), folder / "seg.nii")
    (folder / "seg.txt").write_text("# names\n1 liver 255 0 0 255\n2 left kidney 0 255 0 255\n")
    return folder / "seg.nii"


def tiff_times(suffix: str) -> Seed:
    """A TIFF of ImageJ or OME with times and channels."""

    def write(folder: Path) -> Path:
        values = VALUES.astype(np.uint16).reshape(2, 2, 1, 34, 40).repeat(2, axis=2)
        imagej = {"imagej": True} if suffix == "tif" else {}
        metadata = {"axes": "TZCYX", "unit": "um", "spacing": 2.0, "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.5}
        tifffile.imwrite(folder / f"ct.{suffix}", values, photometric="minisblack", metadata=metadata, **imagej)
        return folder / f"ct.{suffix}"

    return write


def named(seed: Seed, name: str) -> Seed:
    """The seed's one file under a name that says nothing."""

    def write(folder: Path) -> Path:
        return seed(folder).rename(folder / name)

    return write


SEEDS: dict[str, Seed] = {
    "nii": nifti("ct.nii"),
    "nii.gz": nifti("ct.nii.gz"),
    "nii float": nifti("ct.nii", dtype=np.float32),
    "nifti 2": nifti("ct.nii", second=True),
    "nii labels": nifti("seg.nii.gz", dtype=np.uint8),
    "nrrd raw": nrrd_file("raw"),
    "nrrd gzip": nrrd_file("gzip"),
    "nrrd bzip2": nrrd_file("bzip2"),
    "nrrd ascii": nrrd_file("ascii"),
    "nhdr": detached_nrrd,
    "nii times": times,
    "nii pair": nifti_pair,
    "nrrd layers": segment_layers,
    "label table": label_table,
    "imagej times": tiff_times("tif"),
    "imagej calibrated": tiff_calibrated,
    "ome times": tiff_times("ome.tif"),
    "mha": metaimage("ct.mha"),
    "mha zlib": metaimage("ct.mha", True),
    "mhd": metaimage("ct.mhd"),
    "mhd zlib": metaimage("ct.mhd", True),
    "mgz": nibabel_file("MGHImage", "ct.mgz"),
    "mgh": nibabel_file("MGHImage", "ct.mgh"),
    "analyze": nibabel_file("AnalyzeImage", "ct.img"),
    "npy": npy,
    "vff": vff,
    "vgi": flat_pair("ct.vgi"),
    "vol.info": flat_pair("ct.vol.info"),
    "zarr 2": zarr_store("0.4"),
    "zarr 3": zarr_store("0.5"),
    "stl": surface("binary.stl"),
    "stl text": surface("text.stl"),
    "ply": surface("binary.ply"),
    "ply text": surface("text.ply"),
    "png": pictures("png"),
    "png 16": pictures("png", "I;16"),
    "png palette": pictures("png", "P"),
    "png rgba": pictures("png", "RGBA"),
    "jpg": pictures("jpg", quality=95),
    "bmp": pictures("bmp"),
    "bmp 1": pictures("bmp", "1"),
    "jp2": pictures("jp2"),
    "tif": pictures("tif"),
    "tif lzw": pictures("tif", compression="tiff_lzw"),
    "pages": tiff_pages(),
    "pages zlib": tiff_pages(compression="zlib"),
    "pages big": tiff_pages(bigtiff=True, compression="zlib"),
    "pages tiled": tiff_pages(tile=(16, 16), compression="zlib"),
    "pages imagej": tiff_pages(imagej=True),
    "pages ome": tiff_pages(ome=True),
    "pages big endian": tiff_pages(byteorder=">", rowsperstrip=5),
    "pages lzw": tiff_by_pillow("tiff_lzw"),
    "pages jpeg": tiff_by_pillow("jpeg"),
    "pages packbits": tiff_by_pillow("packbits"),
    "pages 1": tiff_of_bits(1),
    "pages 1 packbits": tiff_of_bits(1, PACKBITS),
    "pages 2": tiff_of_bits(2),
    "pages 2 lzw": tiff_of_bits(2, LZW),
    "pages 4": tiff_of_bits(4),
    "pages 4 packbits": tiff_of_bits(4, PACKBITS),
    "pages 12": tiff_of_bits(12),
    "pages 12 lzw": tiff_of_bits(12, LZW),
    "pages 16 zlib differences": tiff_of_bits(16, DEFLATE, differences=True),
    "pages 16 lzw differences": tiff_of_bits(16, LZW, differences=True),
    "pages palette 1": tiff_of_bits(1, palette=True),
    "pages palette 4": tiff_of_bits(4, palette=True),
    "pages palette 8": tiff_of_bits(8, LZW, palette=True),
    "png 1": pictures("png", "1"),
    "no suffix": named(npy, "volume"),
    "dicom": dicom(),
    "dicom implicit": dicom(IMPLICIT),
    "dicom big": dicom(BIG),
    "dicom deflated": dicom(DEFLATED),
    "dicom rle": dicom(compress=RLE),
    "dicom j2k": dicom(compress=J2K),
    "dicom jpeg": dicom(compress=JPEG),
    "dicom no suffix": dicom(name="IM{}"),
    "enhanced": enhanced_dicom,
    "seg": segmentation,
    "rtstruct": structures,
    "rtdose": dose,
    "pet": pet("BQML"),
    "pet counts": pet("CNTS"),
    "dicomdir": dicomdir,
    "masks": masks,
}
