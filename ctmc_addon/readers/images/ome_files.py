# SPDX-License-Identifier: GPL-3.0-or-later
"""Read an OME-TIFF of several files in one folder, such as one for each slice, in the order of its OME-XML.

Names of files come from the XML, so that only files of the same folder are opened, by names without a path.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from ...core import ReadError, Steps
from ...core.files.input_files import add_inputs
from ..file_formats import suffix
from ..optional_imports import quiet_batches_steps
from ..registry import PAGE_SUFFIXES
from .ome_xml import OmeImage, image_with, metadata_file, root_of
from .pillow import Picture
from .slice_names import left_out, limited_names, require_one_stack, runs_by_name
from .tiff import ome_text, plain_page_count, tiff_picture
from .tiff_axes import Pages, pages_of_axes

MOST_XML = 1 << 26  # Read at most this many bytes of metadata.


class _OmeFiles(NamedTuple):
    """An OME-TIFF of several files.

    Parameters
    ----------
    path : Path
        One of its files.
    image : OmeImage
    pages : Pages
        Which of its planes are slices.
    """

    path: Path
    image: OmeImage
    pages: Pages

    @property
    def places(self) -> list[tuple[str, int]]:
        """Return file and page of each slice, time after time.

        Raises
        ------
        ReadError
            If the XML leaves some of them out.
        """
        pages, planes = self.pages, self.image.planes
        numbers = [
            pages.first(time) + at * pages.step for time in range(1, pages.times + 1) for at in range(pages.slices)
        ]
        missing = next((at for at, number in enumerate(numbers) if number not in planes), None)
        if missing is not None:
            raise ReadError(
                f"the OME-XML of {self.path.name} names no file for slice {missing % pages.slices + 1} of "
                f"{pages.slices}; export it again"
            )
        return [planes[number] for number in numbers]

    @property
    def missing(self) -> list[str]:
        """Return the names of files with slices that do not lie in the folder."""
        folder = self.path.parent
        names = dict.fromkeys(name for name, _ in self.places)
        return [name for name in names if Path(name).name != name or not (folder / name).is_file()]


def ome_files_of(path: Path) -> _OmeFiles | None:
    """Return the OME-TIFF of several files that a TIFF is one of; None where it is complete by itself.

    A file of several pages whose other files are missing is read by itself.
    """
    text = ome_text(path)
    if "FileName" not in text and "BinaryOnly" not in text:
        return None
    own = path.name
    root = root_of(text, own)
    companion = "" if root is None else metadata_file(root)
    if companion:
        root, own = _companion_root(path, companion), companion
    if root is None:
        return None

    def count_pages(name: str) -> int:
        file = path.parent / name
        return plain_page_count(file) if Path(name).name == name and file.is_file() else 1

    image = image_with(root, path.name, own, count_pages)
    if image is None or (len(image.files) < 2 and not companion):
        return None
    ome = _OmeFiles(path, image, pages_of_axes(image.axes, image.sizes, path))
    return None if ome.missing and plain_page_count(path) > 1 else ome


def ome_files_among(images: Sequence[Path], folder: str) -> _OmeFiles | None:
    """Return the OME-TIFF that most pictures of a folder belong to, or None; one picture of each run is opened.

    Raises
    ------
    ReadError
        If there are two of like size.
    """
    ome_files: list[_OmeFiles] = []
    runs: list[list[Path]] = []
    rest = list(images)
    for run in runs_by_name(images):
        ome = ome_files_of(run[0]) if run[0] in rest else None
        if ome is not None:
            names = set(ome.image.files)
            ome_files.append(ome)
            runs.append([path for path in rest if path.name in names])
            rest = [path for path in rest if path.name not in names]
    if not ome_files:
        return None
    sizes = [len(run) for run in runs]
    largest = ome_files[sizes.index(max(sizes))]
    runs = sorted([*runs, *runs_by_name(rest)], key=len, reverse=True)
    require_one_stack(runs, folder)
    return largest if max(sizes) == len(runs[0]) else None


def slices_of_ome_steps(ome: _OmeFiles, images: Sequence[Path]) -> Steps[tuple[list[Picture], list[str]]]:
    """Return the headers of all slices, time after time, and notes.

    Parameters
    ----------
    ome : OmeFiles
    images : sequence of Path
        The TIFF files of its folder; those that do not belong to it are named in a note.

    Raises
    ------
    ReadError
        If files are missing, or have fewer pages than the XML says.
    """
    folder, missing = ome.path.parent, ome.missing
    if missing:
        count = len({name for name, _ in ome.places})
        raise ReadError(
            f"{ome.path.name} belongs to an OME-TIFF of {count} files, of which {limited_names(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} not in its folder; copy all of them there under their own names"
        )
    names = list(dict.fromkeys(name for name, _ in ome.places))
    files = [folder / name for name in names]
    headers = yield from quiet_batches_steps(partial(tiff_picture, as_ome=False), files, "Reading headers", 16)
    by_name = dict(zip(names, headers, strict=True))
    slices = []
    for name, page in ome.places:
        header = by_name[name]
        if page >= header.pages:
            raise ReadError(f"{name} has {header.pages} pages, and the OME-XML names page {page + 1}; copy it again")
        slices.append(header._replace(pages=1, page=page, metadata=ome.image.metadata))
    notes = list(ome.pages.notes)
    own_names = set(ome.image.files)
    own = [path for path in images if path.name in own_names]
    notes += left_out(images, own, "not among the files of the OME-TIFF")
    if ome.image.further:
        further = f"{ome.image.further} further image{'s' * (ome.image.further > 1)}"
        notes.append(f"{further} in the OME-XML left out")
    return slices, notes


def _companion_root(path: Path, name: str) -> ElementTree.Element | None:
    """Return the OME-XML of a MetadataFile beside a TIFF; None if it is missing or not OME-XML."""
    file = path.parent / name
    if Path(name).name != name or not file.is_file():
        return None
    if suffix(file) in PAGE_SUFFIXES:
        return root_of(ome_text(file), name)
    add_inputs((file,))
    with file.open("rb") as stream:
        return root_of(stream.read(MOST_XML).decode("utf-8", "replace"), name)
