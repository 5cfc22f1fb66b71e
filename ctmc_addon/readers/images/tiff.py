# SPDX-License-Identifier: GPL-3.0-or-later
"""Read TIFF stacks: tifffile finds pages and the metadata of ImageJ and OME; tiff_page.py reads a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from threading import RLock
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from ...core import PAUSE, ReadError, Steps
from ...core.volume import SliceReader
from ..optional_imports import needed, quiet
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from ..streams.stored_slices import RawSlices, TimeSlices
from ..value_kind import scaled_steps
from .decoded import DecodedSlices
from .pillow import JPEG_NOISE, Picture, gray
from .tiff_axes import Pages, TiffMetadata, metadata_of_tiff, pages_of_axes
from .tiff_page import (
    BLACK_IS_ZERO,
    DAMAGE,
    JPEG,
    MASK,
    PALETTE,
    RGB,
    UNCOMPRESSED,
    WHITE_IS_ZERO,
    YCBCR,
    PageLayout,
    own_page,
    page_layout,
    page_pixels,
    reading,
)

OF_SEVERAL_FILES = ("mmstack", "ndtiff")
MOST_SAMPLES = 4  # A pixel has at most red, green, blue and opacity.
COLORS = (WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, MASK)  # These photometric interpretations are read.
BYTE_CODECS = (UNCOMPRESSED, 5, 8, 32773, 32946, 34925, 50000)  # Their bytes are samples, never YCbCr made RGB.


class _PageStack(NamedTuple):
    """The pages of a TIFF that make one volume."""

    shape: tuple[int, int, int]  # (slices, rows, columns)
    dtype: np.dtype[Any]  # Type of the gray values, in the file's byte order.
    depth: str  # Depth of every page, from the first one.
    pages: list[Any]  # tifffile's pages, one for each slice; empty if the values are contiguous.
    start: int | None  # First byte of contiguous values of all times and channels.
    total: int  # Number of pages.
    layout: Pages
    notes: tuple[str, ...]
    metadata: TiffMetadata


class _TiffStack(VolumeSource):
    """One TIFF of several pages."""

    format = "TIFF"
    has_geometry = False

    def __init__(self, path: Path, stack: _PageStack) -> None:
        slices, rows, columns = stack.shape
        series = Series(1, "", slices, (columns, rows), "", stack.dtype.name, stack.layout.times)
        super().__init__(path, (series,), [path])

    def read_raw_steps(self, request: ReadRequest) -> Steps[RawValues]:
        """Read page by page; values in one piece row by row."""
        yield PAUSE
        tiff = _open_tiff(self.path)
        with ExitStack() as on_error:
            on_error.callback(tiff.close)
            stack = _page_stack(tiff, self.path)
            on_error.pop_all()
        slices, pages = stack.shape[0], stack.layout
        first = pages.first(request.time)
        if stack.start is not None:
            tiff.close()
            plain: SliceReader = RawSlices(self.path, stack.start, (stack.total, *stack.shape[1:]), stack.dtype)
            if stack.total != slices:
                plain = TimeSlices(plain, first, slices, pages.step)
            return (yield from raw_values_steps(plain, stack.metadata, stack.notes, self.path.name, request))

        lock = RLock()

        def decode(number: int) -> NDArray[Any]:
            page = stack.pages[first + number * pages.step]
            if page is None:
                raise ReadError(f"page {number + 1} of {self.path.name} is missing; save it again")
            with lock:  # tifffile seeks for long tags, such as a palette, only when they are asked for.
                with reading(self.path):
                    page = own_page(page)
                layout = page_layout(page, self.path)
            if layout.depth != stack.depth:
                depths = f"{layout.depth}, and the first {stack.depth}"
                raise ReadError(f"page {number + 1} of {self.path.name} has {depths}; save it again")
            return _page_slice(tiff, page, layout, self.path, lock)

        reader = DecodedSlices(decode, stack.shape, stack.dtype.newbyteorder("="), request.budget.thread_count)
        finalize(reader, tiff.close)
        return (yield from raw_values_steps(reader, stack.metadata, stack.notes, self.path.name, request))


def raw_values_steps(
    reader: SliceReader, metadata: TiffMetadata, notes: Sequence[str], what: str, request: ReadRequest
) -> Steps[RawValues]:
    """Return values with their calibration applied, and their spacing.

    Parameters
    ----------
    reader : SliceReader
        The numbers as they are stored.
    metadata : TiffMetadata
    notes : sequence of str
        Other notes, which come first.
    what : str
        What is read, for messages.
    request : ReadRequest
    """
    slope, intercept, calibration_notes = metadata.calibration
    values = yield from scaled_steps(reader, slope, intercept, request.whole, what, request.budget)
    return RawValues(values, None, (*notes, *calibration_notes, *metadata.notes), spacing=metadata.spacing)


def opened_stack(path: Path) -> _TiffStack | None:
    """Return the volume in a TIFF of several pages; None where it has one: a single page is a slice of its folder."""
    with _open_tiff(path) as tiff:
        return _TiffStack(path, _page_stack(tiff, path)) if _pages_of(tiff) > 1 else None


def page_count(path: Path) -> int:
    """Return the number of pages of a TIFF."""
    with _open_tiff(path) as tiff:
        return _pages_of(tiff)


def _pages_of(tiff: Any) -> int:
    """Return the number of pages; ImageJ writes one page header for a large stack."""
    return max(len(tiff.pages), _stack_sides(tiff.series[0]))


def ome_text(path: Path) -> str:
    """Return the OME-XML of a TIFF; empty if it has none or is damaged, which reading its pages reports."""
    tifffile = needed("tifffile", "tifffile", "TIFF")
    try:
        with quiet(), tifffile.TiffFile(path, **_without_companions(tifffile)) as tiff:
            return str(tiff.ome_metadata or "")
    except (*DAMAGE, tifffile.TiffFileError):
        return ""


def plain_page_count(path: Path) -> int:
    """Return the number of pages in this file; its OME-XML may count pages of other files."""
    with _open_tiff(path, as_ome=False) as tiff:
        return len(tiff.pages)


def _open_tiff(path: Path, as_ome: bool = True) -> Any:
    """Return the TIFF, opened by tifffile; a `ReadError` if its pages cannot all be found.

    Parameters
    ----------
    path : Path
    as_ome : bool
        Whether its OME-XML orders its pages.
    """
    tifffile = needed("tifffile", "tifffile", "TIFF")
    with ExitStack() as on_error:
        with reading(path):
            options = {} if as_ome else {"is_ome": False}
            tiff = on_error.enter_context(tifffile.TiffFile(path, **_without_companions(tifffile), **options))
            count, stored = len(tiff.pages), 0
            tiff.filehandle.seek(tiff.pages.next_page_offset)
            if tiff.filehandle.read(tiff.tiff.offsetsize) != bytes(tiff.tiff.offsetsize):
                raise ValueError(f"its chain of pages breaks off after {count}")
            tiff.pages[0], tiff.series[0]  # found when asked for
            if tiff.is_shaped:
                stored = sum(int(np.prod(entry["shape"])) for entry in tiff.shaped_metadata or () if "shape" in entry)
            if stored > sum(series.size for series in tiff.series):
                raise ValueError(f"its {count} pages are fewer than it says")
        on_error.pop_all()
    return tiff


def _without_companions(tifffile: Any) -> dict[str, bool]:
    """Return options that keep tifffile from opening other files that a TIFF names, wherever they lie."""
    kinds = (f"is_{kind}" for kind in OF_SEVERAL_FILES if kind in tifffile.TIFF.FILE_FLAGS)
    # In versions of 2023 some are properties, which cannot be set.
    settable = (kind for kind in kinds if not isinstance(getattr(tifffile.TiffFile, kind, None), property))
    return {"_multifile": False, **dict.fromkeys(settable, False)}


def tiff_picture(path: Path, as_ome: bool = True) -> Picture:
    """Return the header of the first page with the number of pages."""
    with _open_tiff(path, as_ome) as tiff:
        layout = page_layout(tiff.pages[0], path)
        pages = _pages_of(tiff)
        metadata = metadata_of_tiff(tiff, layout, pages > 1)
        return Picture(path, *layout.shape, _gray_dtype(layout), pages, "", metadata=metadata)


def tiff_slice(header: Picture) -> NDArray[Any]:
    """Return the gray values (rows, columns) of a page of one TIFF file."""
    path = header.path
    with _open_tiff(path, as_ome=False) as tiff:
        with reading(path):
            page = own_page(tiff.pages[header.page])
        return _page_slice(tiff, page, page_layout(page, path), path, RLock())


def _gray_dtype(layout: PageLayout) -> np.dtype[Any]:
    """Return the type of a page's gray values, in the machine's byte order."""
    return layout.dtype if layout.colors is None else layout.colors.dtype


def _stack_sides(series: Any) -> int:
    """Return the number of pages of a series."""
    return math.prod(int(side) for axis, side in zip(series.axes, series.shape, strict=True) if axis not in "SYX")


def _page_stack(tiff: Any, path: Path) -> _PageStack:
    """Return the first series of pages, or all pages where each is a series of its own."""
    first, every = tiff.series[0], list(tiff.series)
    layout = page_layout(first.keyframe, path)
    metadata = metadata_of_tiff(tiff, layout, several=True)
    size = layout.shape
    dtype = _gray_dtype(layout).newbyteorder(tiff.byteorder)
    count = _stack_sides(first)
    if count == 1 and len(every) > 1:
        if len({(series.shape, str(series.dtype)) for series in every}) > 1:
            text = ", ".join(sorted({" x ".join(map(str, series.shape)) for series in every})[:3])
            raise ReadError(f"{path.name} has pages of different sizes or types ({text}); save pages of one size")
        single = [page for series in every for page in _pages_in(series, path)]
        count = len(single)
        pages = Pages(count, 1, 1, 0)
        return _PageStack((count, *size), dtype, layout.depth, single, None, count, pages, (), metadata)
    _check_left_out(tiff, every, path)
    layout_of_pages = pages_of_axes(first.axes, first.shape, path)
    shape = (layout_of_pages.slices, *size)
    notes = (f"{len(every) - 1} further series of pages in the TIFF left out",) if len(every) > 1 else ()
    notes = (*notes, *layout_of_pages.notes)
    plain = (layout.samples, layout.photometric, layout.bits) == (1, BLACK_IS_ZERO, 8 * dtype.itemsize)
    if first.dataoffset is not None and plain:
        start = int(first.dataoffset)
        return _PageStack(shape, dtype, layout.depth, [], start, count, layout_of_pages, notes, metadata)
    if len(first.pages) < count:
        raise ReadError(f"{path.name} has {len(first.pages)} of {count} pages; copy it again")
    pages_read = _pages_in(first, path)[:count]
    return _PageStack(shape, dtype, layout.depth, pages_read, None, count, layout_of_pages, notes, metadata)


def _pages_in(series: Any, path: Path) -> list[Any]:
    """Return the pages of a series or file, which tifffile reads on access; None for a missing page."""
    with reading(path):
        return list(series.pages)


def _check_left_out(tiff: Any, every: list[Any], path: Path) -> None:
    """Refuse damaged pages that tifffile left out of the first series, and odd ones between its slices."""
    own: list[int] = []
    if len(every) > 1:
        own = [page.index for page in _pages_in(every[0], path) if page is not None and isinstance(page.index, int)]
    for series in every[1:]:
        for page in filter(None, _pages_in(series, path)):
            page_layout(own_page(page), path)
            same_size = series.shape[-2:] == every[0].shape[-2:]
            if same_size and isinstance(page.index, int) and own and min(own) < page.index < max(own):
                raise ReadError(
                    f"page {page.index + 1} of {path.name} is stored differently from its neighbors; save it again"
                )
    if len(tiff.pages) > sum(len(series.pages) for series in every):  # some are in no series, such as those of no rows
        listed = {page.offset for series in every for page in filter(None, _pages_in(series, path))}
        for page in _pages_in(tiff, path):
            if page.offset not in listed:
                page_layout(own_page(page), path)


def _page_slice(
    tiff: Any, page: Any, layout: PageLayout, path: Path, lock: AbstractContextManager[Any]
) -> NDArray[Any]:
    """Return the gray values (rows, columns) of a page of an open TIFF; the lock is held while the file is read."""
    if layout.samples > MOST_SAMPLES:
        raise ReadError(
            f"{path.name} has {layout.samples} samples for each pixel, and a slice has one; save it as gray"
        )
    as_rgb = layout.photometric == YCBCR and layout.compression not in BYTE_CODECS
    if (layout.photometric not in COLORS and not as_rgb) or (layout.colors is not None and layout.samples > 1):
        raise ReadError(f"{path.name} has colors of PhotometricInterpretation {layout.photometric}; save it as gray")
    pixels = page_pixels(tiff, page, layout, path, lock)
    if layout.photometric == WHITE_IS_ZERO and layout.dtype.kind == "u":
        pixels = np.subtract((1 << layout.bits) - 1, pixels, dtype=layout.dtype)
    if layout.colors is not None:
        pixels = np.moveaxis(layout.colors[:, pixels], 0, -1)
    elif layout.bits == 1:
        pixels = pixels * np.uint8(255)
    return gray(pixels, path.name, JPEG_NOISE if layout.compression == JPEG else 0)
