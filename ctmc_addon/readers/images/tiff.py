"""TIFF by tifffile, and by Pillow where a compression asks for a library that is not there."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Step, Steps
from ..optional_imports import BROKEN, needed, quiet, reason
from ..result import Reading, Series
from ..streams import fill_steps
from ..value_kind import native_steps, require_memory
from .pillow import JPEG_NOISE, MODES, Picture, grey

WHAT = "TIFF"
DAMAGE = (
    "invalid page offset",
    "invalid offset to page",
    "corrupted",
    "suspicious",
)  # what tifffile logs and then passes over


class PageStack(NamedTuple):
    """The pages of a TIFF that make one volume."""

    shape: tuple[int, int, int]  # (slices, rows, columns)
    dtype: np.dtype[Any]  # in the file's byte order
    pages: list[Any]  # tifffile's, one for each slice; empty where the values lie in one piece
    start: int | None  # first byte of values that lie in one piece
    notes: tuple[str, ...]


class Complaints(logging.Handler):
    """Collects what tifffile only logs."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the line."""
        self.lines.append(record.getMessage())


@contextmanager
def opened_tiff(path: Path) -> Iterator[Any]:
    """Open a TIFF; a `ReadError` if its pages cannot all be found."""
    tifffile = needed("tifffile", "tifffile", WHAT)
    logger, heard = logging.getLogger("tifffile"), Complaints()
    propagates, logger.propagate = logger.propagate, False
    logger.addHandler(heard)
    try:
        tiff = tifffile.TiffFile(path)
        try:
            len(tiff.pages), tiff.pages[0], len(tiff.series), tiff.series[0]  # found when asked for
        except (*BROKEN, tifffile.TiffFileError):
            tiff.close()
            raise
    except (*BROKEN, tifffile.TiffFileError) as error:
        raise ReadError(f"{path.name} is no readable TIFF ({reason(error)}); copy it again") from error
    finally:
        logger.removeHandler(heard)
        logger.propagate = propagates
    with tiff:
        damage = next((line for line in heard.lines if any(word in line for word in DAMAGE)), None)
        if damage is not None:
            raise ReadError(f"{path.name} is truncated or damaged ({damage.split('> ')[-1]}); copy it again")
        yield tiff


def tiff_picture(path: Path) -> Picture:
    """What the header says of the first page, and how many pages there are."""
    with opened_tiff(path) as tiff:
        page = tiff.pages[0]
        dtype = np.dtype("uint8") if page.dtype is None or page.dtype == bool else page.dtype
        # ImageJ writes one page header for a large stack.
        pages = max(len(tiff.pages), stack_sides(tiff.series[0])[0])
        return Picture(path, page.imagelength, page.imagewidth, dtype.newbyteorder("="), pages, "", "")


def tiff_slice(path: Path) -> NDArray[Any]:
    """Grey values (rows, columns) of a TIFF of one page."""
    with opened_tiff(path) as tiff:
        return page_slice(tiff.pages[0], path, 0)


def tiff_steps(path: Path) -> Steps[Reading]:
    """Read a multi-page TIFF page by page; values in one piece straight into place."""
    with opened_tiff(path) as tiff:
        stack = page_stack(tiff, path)
        require_memory(stack.shape, stack.dtype.itemsize, path.name)
        values = np.empty(stack.shape, stack.dtype if stack.start is not None else stack.dtype.newbyteorder("="))
        if stack.start is not None:
            with path.open("rb") as stream:
                stream.seek(stack.start)
                yield from fill_steps(values, stream, path.name)
        for number, page in enumerate(stack.pages):
            yield Step(number / len(stack.pages), "Decoding pages")
            found = page_slice(page, path, page.index)
            if found.shape != values.shape[1:]:
                size = f"{found.shape}, and the first is {values.shape[1:]}"
                raise ReadError(f"page {number + 1} of {path.name} is {size}; save it again")
            values[number] = found
    values = yield from native_steps(values)
    return Reading(values, None, stack.notes, what=WHAT)


def describe_tiff(path: Path) -> Series:
    """Size of a multi-page TIFF, from its headers."""
    with opened_tiff(path) as tiff:
        slices, rows, columns = page_stack(tiff, path).shape
    return Series(1, "", slices, (columns, rows))


def stack_sides(series: Any) -> tuple[int, str]:
    """Number of pages of a series, and its sides in words."""
    sides = list(zip(series.axes, (int(side) for side in series.shape), strict=True))
    stack = [side for axis, side in sides if axis not in "SYX" and side > 1]
    return int(np.prod(stack)), " x ".join(f"{axis} {side}" for axis, side in sides)


def page_stack(tiff: Any, path: Path) -> PageStack:
    """The first series of pages, or all pages where each is a series of its own."""
    first, many = tiff.series[0], list(tiff.series)
    keyframe = first.keyframe
    size = (int(keyframe.imagelength), int(keyframe.imagewidth))
    dtype = np.dtype("uint8") if first.dtype == bool else first.dtype.newbyteorder(tiff.byteorder)
    count, sides = stack_sides(first)
    if count == 1 and len(many) > 1:
        if len({(one.shape, str(one.dtype)) for one in many}) > 1:
            text = ", ".join(sorted({" x ".join(map(str, one.shape)) for one in many})[:3])
            raise ReadError(f"{path.name} has pages of different sizes or types ({text}); save pages of one size")
        pages = [page for one in many for page in one.pages]
        return PageStack((len(pages), *size), dtype, pages, None, ())
    stack = [(axis, side) for axis, side in zip(first.axes, first.shape, strict=True) if axis not in "SYX" and side > 1]
    # ImageJ calls the slices of a plain stack channels; up to four may be real ones.
    if len(stack) > 1 or (stack and stack[0][0] == "C" and stack[0][1] <= 4):
        raise ReadError(f"{path.name} has more than one channel or time ({sides}); save one as a stack of its own")
    if not stack:
        raise ReadError(f"{path.name} holds one slice only; a surface needs at least 2 slices")
    notes = (f"{len(many) - 1} further series of pages in the TIFF left out",) if len(many) > 1 else ()
    plain = keyframe.samplesperpixel == 1 and int(keyframe.photometric) == 1 and first.dtype != bool
    if first.dataoffset is not None and plain:
        return PageStack((count, *size), dtype, [], int(first.dataoffset), notes)
    return PageStack((count, *size), dtype, [first.pages[number] for number in range(count)], None, notes)


def page_slice(page: Any, path: Path, number: int) -> NDArray[Any]:
    """Grey values (rows, columns) of an open page, number `number` of `path`."""
    about = page.keyframe  # of a series, only the first page knows all of this
    try:
        with quiet():
            found = np.asarray(page.asarray())
    except (*BROKEN, needed("tifffile", "tifffile", WHAT).TiffFileError) as error:
        found = _by_pillow(path, number, about, error)
    else:
        if found.ndim == 3 and int(about.planarconfig) == 2:
            found = np.moveaxis(found, 0, -1)  # colour planes one behind the other
        if int(about.photometric) == 0 and found.dtype.kind in "bu":  # white is zero
            found = ~found
    if found.dtype == bool:
        found = found.astype(np.uint8) * np.uint8(255)
    return grey(found, path.name, JPEG_NOISE if "JPEG" in str(about.compression) else 0)


def _by_pillow(path: Path, number: int, about: Any, error: BaseException) -> NDArray[Any]:
    pillow = needed("PIL.Image", "Pillow", WHAT)
    name = getattr(about.compression, "name", str(about.compression))
    try:
        with quiet(), pillow.open(path) as image:
            image.seek(number)
            mode = MODES.get(image.mode, (None,))[0]
            return np.asarray(image.convert(mode) if mode else image)
    except BROKEN as second:
        if "imagecodecs" in str(error):
            raise ReadError(
                f"{path.name} is compressed as {name}, which needs the Python package imagecodecs; "
                "save it uncompressed or with Deflate"
            ) from second
        raise ReadError(f"{path.name} is truncated or damaged ({reason(error)}); copy it again") from second
