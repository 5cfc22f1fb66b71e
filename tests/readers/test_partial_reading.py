# SPDX-License-Identifier: GPL-3.0-or-later
"""A region, a stride and slabs of a file are those of the volume read whole: values, type, kind and place."""

from __future__ import annotations

import gzip
import warnings
from concurrent.futures import ThreadPoolExecutor

import nibabel
import nrrd
import numpy as np
import pytest
import tifffile
from PIL import Image
from pydicom import uid

from ctmc_addon.core import Budget, CtmcError, finish
from ctmc_addon.readers import open_volume, read_volume

SHAPE = (9, 40, 33)
LPS = {"space": "left-posterior-superior", "space directions": np.diag([0.5, 0.7, 2.0]), "space origin": [1, 2, 3]}


def numbers(dtype="i2", low=-120, high=120):
    low = max(low, np.iinfo(dtype).min) if np.dtype(dtype).kind in "iu" else low
    return np.random.default_rng(3).integers(low, high, SHAPE).astype(dtype)


def npy(dtype="u1", order="C"):
    def write(folder):
        np.save(folder / "ct.npy", np.asarray(numbers(dtype), order=order))
        return folder / "ct.npy"

    return write


def nrrd_file(encoding, dtype="i2", detached=False, **header):
    def write(folder):
        path = folder / ("ct.nhdr" if detached else "ct.nrrd")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pynrrd's own, with the newest NumPy
            nrrd.write(str(path), numbers(dtype).T, {**LPS, "encoding": encoding, **header}, detached_header=detached)
        return path

    return write


def nrrd_list(folder):
    values = numbers()
    for z in range(0, 9, 3):
        values[z : z + 3].tofile(folder / f"part{z}.raw")
    names = "\n".join(f"part{z}.raw" for z in range(0, 9, 3))
    head = "NRRD0004\ntype: short\ndimension: 3\nsizes: 33 40 9\nencoding: raw\nendian: little\ndata file: LIST\n"
    (folder / "ct.nhdr").write_text(f"{head}{names}\n")
    return folder / "ct.nhdr"


def nifti(end, dtype="i2", scale=None, low=-120, high=120, name="ct"):
    def write(folder):
        path = folder / f"{name}.nii"
        nibabel.save(nibabel.Nifti1Image(numbers(dtype, low, high).T, np.diag([0.5, 0.7, 2.0, 1.0])), path)
        content = bytearray(path.read_bytes())
        if scale is not None:
            content[112:120] = np.array(scale, "<f4").tobytes()
        path.unlink()
        path = folder / f"{name}{end}"
        path.write_bytes(gzip.compress(bytes(content)) if end.endswith("gz") else bytes(content))
        return path

    return write


def tiff(dtype="u2", **options):
    def write(folder):
        tifffile.imwrite(folder / "ct.tif", numbers(dtype, 0), photometric="minisblack", **options)
        return folder / "ct.tif"

    return write


def images(end):
    def write(folder):
        for z, plane in enumerate(numbers("u1", 0)):
            Image.fromarray(plane).save(folder / f"{z:02}{end}")
        return folder

    return write


def dicom(z=range(9), **tags):
    def write(folder, save_stack):
        save_stack(folder, z, SHAPE[1:], **tags)
        return folder

    return write


FILES = {
    "npy": npy(),
    "npy Fortran": npy("i2", "F"),
    "npy big-endian": npy(">i2"),
    "npy float": npy("f4"),
    "nrrd raw": nrrd_file("raw"),
    "nrrd big-endian": nrrd_file("raw", ">i4"),
    "nrrd gzip": nrrd_file("gzip", "f4"),
    "nrrd bzip2 big-endian": nrrd_file("bzip2", ">i2"),
    "nrrd ASCII": nrrd_file("ASCII"),
    "nhdr gzip": nrrd_file("gzip", detached=True),
    "nhdr list": nrrd_list,
    "nifti": nifti(".nii"),
    "nifti labels": nifti(".nii", "u1", low=0, high=9),
    "nifti many labels": nifti(".nii.gz", "u1", low=0, high=200),
    "nifti named mask of floats": nifti(".nii.gz", "f4", name="mask"),
    "nifti HU": nifti(".nii.gz", low=-1000),
    "nifti scaled to 16 bits by its type": nifti(".nii.gz", "u1", (2, -1024)),
    "nifti scaled to 16 bits by its values": nifti(".nii", "i2", (1, -1024)),
    "nifti scaled to 32 bits": nifti(".nii.gz", "i2", (400, 0)),
    "nifti scaled to float": nifti(".nii", "i2", (0.5, 7)),
    "tiff": tiff(),
    "tiff pages apart": tiff(contiguous=False, metadata=None),
    "tiff big-endian": tiff(byteorder=">"),
    "tiff deflate strips": tiff("u1", compression="zlib", rowsperstrip=4),
    "tiff deflate big-endian": tiff(byteorder=">", compression="zlib"),
    "tiff tiles": tiff("f4", tile=(16, 16)),
    "png": images(".png"),
    "jpeg": images(".jpg"),
    "bmp": images(".bmp"),
    "dicom": dicom(),
    "dicom with padding": dicom(PixelPaddingValue=17, PixelPaddingRangeLimit=500),
    "dicom of 12 bits": dicom(BitsStored=12),
    "dicom to 32 bits": dicom(RescaleSlope=30),
    "dicom to float": dicom(RescaleSlope=0.3),
    "dicom RLE": dicom(compress=uid.RLELossless),
    "dicom JPEG 2000": dicom(compress=uid.JPEG2000Lossless),
    "dicom uneven": dicom((0, 1, 2, 4, 5, 7, 8, 9, 10)),
    "dicom uneven with padding": dicom((0, 1, 2, 4, 5, 7, 8, 9, 11), PixelPaddingValue=17, PixelPaddingRangeLimit=500),
    "dicom in the other order": dicom(range(9, 0, -1)),
}


@pytest.fixture(params=FILES)
def path(request, tmp_path, save_stack):
    write = FILES[request.param]
    return write(tmp_path, save_stack) if request.param.startswith("dicom") else write(tmp_path)


def test_any_box_and_stride_is_that_of_the_whole(path, request):
    whole = read_volume(path)
    random = np.random.default_rng(1)
    decoded_elsewhere = request.node.callspec.params["path"] == "dicom JPEG 2000"  # by a process for each read
    for number in range(2 if decoded_elsewhere else 6):
        sides = np.array(whole.size)
        low = random.integers(0, sides - 1)
        high = random.integers(low + 1, sides)
        stride = (
            tuple(int(side) for side in random.integers(1, np.minimum(high - low, 4) + 1)) if number % 2 else (1, 1, 1)
        )
        part = read_volume(path, region=(*low, *high), stride=stride)
        x, y, z = (slice(start, stop + 1, side) for start, stop, side in zip(low, high, stride, strict=True))
        np.testing.assert_array_equal(part.values, whole.values[z, y, x])
        assert part.values.dtype == whole.values.dtype
        assert (part.kind, part.name, part.notes) == (whole.kind, whole.name, whole.notes)
        place = whole.affine @ np.array([*low, 1])
        np.testing.assert_allclose(part.affine[:3, 3], place[:3], atol=1e-9)
        np.testing.assert_allclose(part.affine[:3, :3], whole.affine[:3, :3] * stride)


@pytest.mark.parametrize("thickness", [1, 4])
def test_slabs_one_behind_the_other_are_the_whole(path, thickness):
    whole = read_volume(path)
    slabs = finish(open_volume(path).slabs_steps())
    assert slabs.shape == whole.values.shape
    assert slabs.dtype == whole.values.dtype
    assert (slabs.kind, slabs.name, slabs.notes) == (whole.kind, whole.name, whole.notes)
    np.testing.assert_array_equal(slabs.affine, whole.affine)
    for _ in range(2):  # and again from the first slice on
        parts = [slabs.slab(z, min(z + thickness, slabs.shape[0])) for z in range(0, slabs.shape[0], thickness)]
        np.testing.assert_array_equal(np.concatenate(parts), whole.values)
        assert all(part.dtype == whole.values.dtype and part.flags.c_contiguous for part in parts)


def test_flipped_and_respaced_regions_in_millimeters_are_those_of_the_whole(tmp_path):
    path = npy("i2")(tmp_path)
    options = {"spacing": (0.5, 0.6, 2.0), "flip": "xz"}
    whole = read_volume(path, **options)
    low, high = (whole.affine @ np.array([[2, 3, 1, 1], [9, 20, 7, 1]]).T)[:3].T
    region = (*np.minimum(low, high), *np.maximum(low, high))
    part = read_volume(path, region=region, region_unit="mm", **options)
    np.testing.assert_array_equal(part.values, whole.values[1:8, 3:21, 2:10])
    np.testing.assert_allclose(part.affine[:3, 3], (whole.affine @ [2, 3, 1, 1])[:3])


def test_a_stride_longer_than_the_volume_and_one_of_no_samples_are_refused(tmp_path):
    path = npy()(tmp_path)
    with pytest.raises(CtmcError, match="stride 9 along z leaves fewer than 2 of 9 samples"):
        read_volume(path, stride=(1, 1, 9))
    with pytest.raises(CtmcError, match="stride takes 3 whole numbers"):
        read_volume(path, stride=(0, 1, 1))
    with pytest.raises(CtmcError, match=r"region .* leaves fewer than 2"):
        read_volume(path, region=(50, 0, 0, 60, 5, 5))


def test_a_refusal_names_a_stride_that_fits_and_that_reads(tmp_path):
    np.save(tmp_path / "ct.npy", np.zeros((40, 50, 60), np.int16))
    source = open_volume(tmp_path / "ct.npy")
    budget = Budget(bytes=100_000)
    with pytest.raises(
        CtmcError, match=r"60 x 50 x 40\) needs about 0.229 MiB .* read with a stride of 2 2 2 it takes"
    ):
        source.read(budget=budget)
    assert source.read(budget=budget, stride=(2, 2, 2)).values.nbytes <= 100_000
    with pytest.raises(CtmcError, match="stride of 2 2 2"):
        source.read(budget=budget, region=(0, 0, 0, 55, 49, 39))


def test_readers_say_whether_threads_may_share_them(tmp_path):
    """Plain values are read by a file of the call's own, packed ones by a stream that goes on."""
    shared = {"npy": npy(), "fortran": npy(order="F"), "raw": nrrd_file("raw"), "list": nrrd_list}
    packed = {"gzip": nrrd_file("gzip"), "nii.gz": nifti(".nii.gz")}
    said = {}
    for name, write in {**shared, **packed}.items():
        (tmp_path / name).mkdir()
        reader = finish(open_volume(write(tmp_path / name)).slabs_steps()).reader
        said[name] = (reader.thread_safe, reader.chunk_slices)
    assert said == dict.fromkeys(shared, (True, 1)) | dict.fromkeys(packed, (False, 1))


def test_threads_that_share_a_reader_get_their_own_values(tmp_path):
    reader = finish(open_volume(npy("i2")(tmp_path)).slabs_steps()).reader
    expected = numbers("i2")

    def plane(number):
        return reader.read(range(number % 9, number % 9 + 1), range(1, 40, 3), range(2, 33))

    with ThreadPoolExecutor(4) as pool:
        planes = list(pool.map(plane, range(90)))
    for number, values in enumerate(planes):
        np.testing.assert_array_equal(values[0], expected[number % 9, 1:40:3, 2:33])
