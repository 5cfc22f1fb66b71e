"""A folder of image slices or a NumPy file to values; neither has orientation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Steps, within
from ..file_formats import IMAGE_SUFFIXES, TIFF_SUFFIXES, natural, suffix
from ..optional_imports import BROKEN, imported_steps, quiet, quiet_batches, reason
from ..result import Reading, Series
from ..streams import fill_steps
from ..value_kind import native_steps, require_memory
from .pillow import DECODED, Picture, grey_slice, picture
from .tiff import describe_tiff, tiff_picture, tiff_slice, tiff_steps

SAME_FORMAT = {".jpeg": ".jpg", ".tiff": ".tif"}
WORDS = {".png": "PNG", ".jpg": "JPEG", ".bmp": "BMP", ".tif": "TIFF"}


def images_in(folder: Path) -> list[Path]:
    """The image files of a folder, in natural order; hidden ones are passed over."""
    files = (path for path in folder.iterdir() if suffix(path) in IMAGE_SUFFIXES and not path.name.startswith("."))
    return sorted((path for path in files if path.is_file()), key=natural)


def header_of(path: Path) -> Picture:
    """What an image's header says, whatever its format."""
    return tiff_picture(path) if suffix(path) in TIFF_SUFFIXES else picture(path)


def slice_of(header: Picture) -> NDArray[Any]:
    """Grey values (rows, columns) of an image of one page."""
    return grey_slice(header) if header.mode else tiff_slice(header.path)


def one_format(images: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """The images of the commonest format, and the note that says what was left out."""
    formats = Counter(SAME_FORMAT.get(suffix(path), suffix(path)) for path in images)
    best = max(formats, key=lambda end: (formats[end], -list(WORDS).index(end)))
    kept = [path for path in images if SAME_FORMAT.get(suffix(path), suffix(path)) == best]
    others = [f"{count} {WORDS[end]}" for end, count in sorted(formats.items()) if end != best]
    return kept, [f"{' and '.join(others)} beside the {len(kept)} {WORDS[best]} slices left out"] if others else []


def folder_steps(folder: Path, threads: int) -> Steps[Reading]:
    """Read the slices of a folder, one image each."""
    images, notes = one_format(images_in(folder))
    headers = yield from within(quiet_batches(header_of, images, "Reading headers", 16), 0.0, 0.2)
    if len(headers) == 1:
        if headers[0].pages > 1:
            return (yield from tiff_steps(images[0]))
        raise ReadError(f"{folder.name} has one slice only ({images[0].name}); a surface needs at least 2 slices")
    check_alike(headers)
    first = headers[0]
    shape = (len(headers), first.rows, first.columns)
    require_memory(shape, first.dtype.itemsize, folder.name)
    values = np.empty(shape, first.dtype)
    if first.mode:
        yield from within(imported_steps("imageio.v3", "imageio", DECODED), 0.2, 0.2)

    def fill(at: int) -> None:
        found = slice_of(headers[at])
        if found.shape != values.shape[1:] or found.dtype.itemsize > values.dtype.itemsize:
            raise ReadError(
                f"{headers[at].path.name} is {found.shape} {found.dtype}, not as its header says; save it again"
            )
        values[at] = found

    decoding = quiet_batches(fill, range(len(headers)), "Decoding slices", 2 * threads, threads)
    yield from within(decoding, 0.2, 1.0)
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
    if len(images) == 1 and header_of(images[0]).pages > 1:
        return describe_tiff(images[0])
    first = header_of(images[0])
    return Series(1, "", len(images), (first.columns, first.rows))


def npy_steps(path: Path) -> Steps[Reading]:
    """Read a NumPy file of (slices, rows, columns), in the order it was saved."""
    with path.open("rb") as stream:
        shape, fortran, dtype = npy_header(stream, path.name)
        require_memory(shape, dtype.itemsize, path.name)
        values: NDArray[Any] = np.empty(shape, dtype, order="F" if fortran else "C")
        yield from fill_steps(values, stream, path.name)
    values = yield from native_steps(values)
    return Reading(values, None, what="a NumPy file")


def npy_header(stream: Any, name: str) -> tuple[tuple[int, int, int], bool, np.dtype[Any]]:
    """Shape without axes of 1 beyond the third, memory order and type; `stream` is left at the values."""
    npy: Any = np.lib.format
    try:
        read = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
        with quiet():
            shape, fortran, dtype = read(stream)
    except (*BROKEN, TokenError) as error:  # the header is a line of Python
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
