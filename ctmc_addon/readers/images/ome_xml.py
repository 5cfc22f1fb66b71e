# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the OME-XML of a TIFF: the file and page that hold each plane, and the spacing.

OME model 2016-06: `TiffData` places PlaneCount pages from IFD on, in DimensionOrder from FirstZ, FirstC and FirstT on;
its `UUID` names the file. `BinaryOnly` leaves all of it to a MetadataFile.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import NamedTuple
from xml.etree import ElementTree

from ...core import ReadError
from .tiff_axes import TiffMetadata, spacing_of_ome

MOST_PLANES = 1 << 20
ORDERS = ("XYZCT", "XYZTC", "XYCTZ", "XYCZT", "XYTCZ", "XYTZC")


class OmeImage(NamedTuple):
    """One `Image` of OME-XML.

    Parameters
    ----------
    axes : str
        Letters of the planes' axes, the slowest first, such as 'TCZ'.
    sizes : tuple of int
        Along each of `axes`.
    planes : mapping of int to (str, int)
        File and page of each plane, by its number in the order of `axes`.
    metadata : TiffMetadata
        Its spacing.
    further : int
        Other images in the same XML.
    """

    axes: str
    sizes: tuple[int, ...]
    planes: Mapping[int, tuple[str, int]]
    metadata: TiffMetadata
    further: int

    @property
    def files(self) -> tuple[str, ...]:
        """Return the names of its files, in the order of their planes."""
        return tuple(dict.fromkeys(self.planes[number][0] for number in sorted(self.planes)))


def root_of(text: str, own: str) -> ElementTree.Element | None:
    """Return the root of the OME-XML of a file; None for other text.

    Raises
    ------
    ReadError
        If it defines entities: OME has none, and a short text could unfold to any length.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise _damaged(own, "it defines entities")
    try:
        return ElementTree.fromstring(text.strip("\0 \r\n\t"))
    except (ElementTree.ParseError, ValueError):
        return None


def metadata_file(root: ElementTree.Element) -> str:
    """Return the name of the file with the metadata of a `BinaryOnly` file, or ''."""
    return next((child.get("MetadataFile", "") for child in root if _tag(child) == "BinaryOnly"), "")


def image_with(root: ElementTree.Element, file: str, own: str, count_pages: Callable[[str], int]) -> OmeImage | None:
    """Return the first image that has planes in a file, else the first one; None where there is none.

    Parameters
    ----------
    root : Element
    file : str
        Name of the file that is read.
    own : str
        Name of the file that has the XML: planes whose file is not named lie in it.
    count_pages : callable
        From the name of a file to its number of pages.

    Raises
    ------
    ReadError
        If a number in it is damaged.
    """
    pixels = [each for image in root if _tag(image) == "Image" for each in image if _tag(each) == "Pixels"]
    images = [_image(each, len(pixels) - 1, own, count_pages) for each in pixels]
    return next((image for image in images if file in image.files), images[0] if images else None)


def _image(pixels: ElementTree.Element, further: int, own: str, count_pages: Callable[[str], int]) -> OmeImage:
    order = pixels.get("DimensionOrder", ORDERS[0])
    if order not in ORDERS:
        raise _damaged(own, f"DimensionOrder '{order[:20]}'")
    lengths = {axis: _whole(pixels, f"Size{axis}", 1, own, 1) for axis in "ZCT"}
    channel = next((each for each in pixels if _tag(each) == "Channel"), None)
    samples = 1 if channel is None else _whole(channel, "SamplesPerPixel", 1, own, 1)
    lengths["C"] = max(1, lengths["C"] // samples)  # the samples of a pixel lie in one plane
    steps, total = {}, 1
    for axis in order[2:]:
        steps[axis] = total
        total *= lengths[axis]
    if total > MOST_PLANES:
        raise _damaged(own, f"{total} planes")
    planes: dict[int, tuple[str, int]] = {}
    for data in pixels:
        if _tag(data) != "TiffData":
            continue
        uuid = next((each for each in data if _tag(each) == "UUID"), None)
        file = own if uuid is None else uuid.get("FileName", own)
        page = _whole(data, "IFD", 0, own)
        count = _whole(data, "PlaneCount", 1 if "IFD" in data.attrib else 0, own) or count_pages(file)
        first = sum(step * _whole(data, f"First{axis}", 0, own) for axis, step in steps.items())
        for at in range(min(count, total - first)):
            planes[first + at] = (file, page + at)
    axes = order[:1:-1]
    metadata = TiffMetadata(*spacing_of_ome(pixels.attrib))
    return OmeImage(axes, tuple(lengths[axis] for axis in axes), planes, metadata, further)


def _whole(element: ElementTree.Element, key: str, default: int, own: str, least: int = 0) -> int:
    """Return a whole number of an element."""
    text = element.get(key)
    if text is None:
        return default
    if not re.fullmatch(r"\s*\+?[0-9]{1,9}\s*", text) or int(text) < least:
        raise _damaged(own, f"{key} '{text[:20]}'")
    return int(text)


def _damaged(own: str, what: str) -> ReadError:
    return ReadError(f"the OME-XML of {own} is damaged ({what}); export it again")


def _tag(element: ElementTree.Element) -> str:
    """Return an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]
