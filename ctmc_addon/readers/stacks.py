"""A folder of image slices, a multi-page TIFF or a NumPy file to values; none of them has orientation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import ReadError
from ..core.progress import Step, Steps, within
from .images import Picture, grey_slice, page_slice, picture
from .libraries import BROKEN, needed, quiet, reason
from .paths import IMAGE_SUFFIXES, natural, suffix
from .pool import mapped, pool_size
from .reading import Reading, Series, native, require_memory
from .streams import fill_steps

SAME_FORMAT = {".jpeg": ".jpg", ".tiff": ".tif"}
WORDS = {".png": "PNG", ".jpg": "JPEG", ".bmp": "BMP", ".tif": "TIFF"}


def images_in(folder: Path) -> list[Path]:
    """The image files of a folder, in natural order; hidden ones are passed over."""
    files = (path for path in folder.iterdir() if suffix(path) in IMAGE_SUFFIXES and not path.name.startswith("."))
    return sorted((path for path in files if path.is_file()), key=natural)


def one_format(images: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """The images of the commonest format, and the note that says what was left out."""
    formats = Counter(SAME_FORMAT.get(suffix(path), suffix(path)) for path in images)
    best = max(formats, key=lambda end: (formats[end], -list(WORDS).index(end)))
    kept = [path for path in images if SAME_FORMAT.get(suffix(path), suffix(path)) == best]
    others = [f"{count} {WORDS[end]}" for end, count in sorted(formats.items()) if end != best]
    return kept, [f"{' and '.join(others)} beside the {len(kept)} {WORDS[best]} slices left out"] if others else []


def folder_steps(folder: Path, threads: int | None) -> Steps[Reading]:
    """Read the slices of a folder, one image each."""
    images, notes = one_format(images_in(folder))
    headers = yield from within(mapped(picture, images, "Reading headers", threads, batch=64), 0.0, 0.2)
    if len(headers) == 1:
        if headers[0].pages > 1:
            return (yield from tiff_steps(images[0]))
        raise ReadError(f"{folder.name} has one slice only ({images[0].name}); a surface needs at least 2 slices")
    check_alike(headers)
    first = headers[0]
    shape = (len(headers), first.rows, first.columns)
    require_memory(shape, first.dtype, f"reading {folder.name}")
    values = np.empty(shape, first.dtype)

    def fill(at: int) -> None:
        found = grey_slice(headers[at])
        if found.shape != values.shape[1:] or found.dtype.itemsize > values.dtype.itemsize:
            raise ReadError(
                f"{headers[at].path.name} is {found.shape} {found.dtype}, not as its header says; save it again"
            )
        values[at] = found

    batch = pool_size(threads) * 4
    yield from within(mapped(fill, range(len(headers)), "Decoding slices", threads, batch), 0.2, 1.0)
    word = WORDS[SAME_FORMAT.get(suffix(images[0]), suffix(images[0]))]
    if word == "JPEG":
        notes.append("JPEG is lossy: the grey values are near the original ones, not equal to them")
    return Reading(values, None, tuple(notes), what=word)


def check_alike(headers: Sequence[Picture]) -> None:
    """Refuse slices of different sizes or depths, naming the first odd one."""
    pages = next((one for one in headers if one.pages > 1), None)
    if pages is not None:
        raise ReadError(
            f"{pages.path.name} has {pages.pages} pages among {len(headers)} TIFF files; choose one multi-page file"
        )
    for get, what in ((_size, "size"), (_depth, "depth")):
        counts = Counter(get(one) for one in headers)
        usual = counts.most_common(1)[0][0]
        odd = next((one for one in headers if get(one) != usual), None)
        if odd is not None:
            raise ReadError(
                f"the slices differ in {what}: {odd.path.name} is {get(odd)} and most are {usual}; "
                "take the others out of the folder"
            )


def _size(header: Picture) -> str:
    return f"{header.columns} x {header.rows} pixels"


def _depth(header: Picture) -> str:
    return f"{header.dtype}"


def describe_folder(folder: Path) -> Series:
    """Size of a folder's stack, from its first image."""
    images, _ = one_format(images_in(folder))
    if len(images) == 1 and picture(images[0]).pages > 1:
        return describe_tiff(images[0])
    first = picture(images[0])
    return Series(1, "", len(images), (first.columns, first.rows))


def tiff_steps(path: Path) -> Steps[Reading]:
    """Read a multi-page TIFF, page by page; an uncompressed ImageJ stack in one go."""
    tifffile = needed("tifffile", "tifffile", "TIFF")
    try:
        with quiet():
            tiff = tifffile.TiffFile(path)
    except BROKEN as error:
        raise ReadError(f"{path.name} is no readable TIFF ({reason(error)}); copy it again") from error
    with tiff:
        shape, dtype, notes = tiff_shape(tiff, path)
        require_memory(shape, dtype, f"reading {path.name}")
        series = tiff.series[0]
        if (
            series.dataoffset is not None
            and series.keyframe.samplesperpixel == 1
            and int(series.keyframe.photometric) == 1
        ):
            values = np.empty(shape, series.dtype.newbyteorder(tiff.byteorder))
            with path.open("rb") as stream:
                stream.seek(series.dataoffset)
                yield from fill_steps(values, stream, path.name)
            return Reading(native(values), None, notes, what="TIFF")
        values = np.empty(shape, dtype)
        for number in range(shape[0]):
            yield Step(number / shape[0], "Decoding pages")
            try:
                page = series.pages[number]
            except BROKEN as error:
                raise ReadError(
                    f"{path.name} is truncated at page {number + 1} ({reason(error)}); copy it again"
                ) from error
            found = page_slice(page, path, page.index)
            if found.shape != shape[1:]:
                raise ReadError(
                    f"page {number + 1} of {path.name} is {found.shape}, and the first is {shape[1:]}; save it again"
                )
            values[number] = found
    return Reading(values, None, notes, what="TIFF")


def tiff_shape(tiff: Any, path: Path) -> tuple[tuple[int, int, int], np.dtype[Any], tuple[str, ...]]:
    """(slices, rows, columns), type and notes of a TIFF's first series of pages."""
    series = tiff.series[0]
    sides = [(axis, int(side)) for axis, side in zip(series.axes, series.shape, strict=True)]
    stack = [(axis, side) for axis, side in sides if axis not in "SYX" and side > 1]
    image = dict(sides)
    sizes = {one.shape for one in tiff.series}
    if len(tiff.series) > 1 and len(stack) == 0:
        text = ", ".join(" x ".join(map(str, size)) for size in sorted(sizes)[:3])
        raise ReadError(f"{path.name} has pages of different sizes ({text}); save pages of one size")
    if len(stack) > 1 or any(axis == "C" for axis, _ in stack):
        text = " x ".join(f"{axis} {side}" for axis, side in sides)
        raise ReadError(f"{path.name} has more than one channel or time ({text}); save one as a stack of its own")
    if not stack:
        raise ReadError(f"{path.name} holds one slice only; a surface needs at least 2 slices")
    notes = (f"{len(tiff.series) - 1} further series of pages in the TIFF left out",) if len(tiff.series) > 1 else ()
    dtype = np.dtype("uint8") if series.dtype == bool else series.dtype.newbyteorder("=")
    return (stack[0][1], image["Y"], image["X"]), dtype, notes


def describe_tiff(path: Path) -> Series:
    """Size of a multi-page TIFF, from its headers."""
    tifffile = needed("tifffile", "tifffile", "TIFF")
    try:
        with quiet(), tifffile.TiffFile(path) as tiff:
            slices, rows, columns = tiff_shape(tiff, path)[0]
    except BROKEN as error:
        raise ReadError(f"{path.name} is no readable TIFF ({reason(error)}); copy it again") from error
    return Series(1, "", slices, (columns, rows))


def npy_steps(path: Path) -> Steps[Reading]:
    """Read a NumPy file of (slices, rows, columns), in the order it was saved."""
    with path.open("rb") as stream:
        shape, fortran, dtype = npy_header(stream, path.name)
        require_memory(shape, dtype, f"reading {path.name}")
        values: NDArray[Any] = np.empty(shape, dtype, order="F" if fortran else "C")
        yield from fill_steps(values, stream, path.name)
    return Reading(native(values), None, what="a NumPy file")


def npy_header(stream: Any, name: str) -> tuple[tuple[int, int, int], bool, np.dtype[Any]]:
    """Shape without axes of 1 beyond the third, memory order and type; `stream` is left at the values."""
    npy: Any = np.lib.format
    try:
        read = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
        with quiet():
            shape, fortran, dtype = read(stream)
    except BROKEN as error:
        raise ReadError(f"{name} is no readable NumPy file ({reason(error)}); save it again with numpy.save") from error
    sides = [side for side in shape if side != 1] if len(shape) > 3 else list(shape)
    if len(sides) != 3 or (len(shape) == 4 and shape[-1] in (3, 4)):
        raise ReadError(f"{name} has the shape {shape}, and a volume is (slices, rows, columns); save one volume")
    if dtype.kind not in "buif" or dtype.itemsize > 8 or dtype == np.float16:
        raise ReadError(f"{name} holds values of type {dtype}; convert them to int16 or float32")
    return (sides[0], sides[1], sides[2]), fortran, dtype


def describe_npy(path: Path) -> Series:
    """Size of a NumPy file, from its header."""
    with path.open("rb") as stream:
        slices, rows, columns = npy_header(stream, path.name)[0]
    return Series(1, "", slices, (columns, rows))
