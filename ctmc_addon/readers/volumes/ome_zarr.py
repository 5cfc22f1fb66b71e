# SPDX-License-Identifier: GPL-3.0-or-later
"""Read OME-Zarr 0.4 and 0.5, a folder: an image or its labels in several resolutions, each a Zarr array.

ngff.openmicroscopy.org/0.5 is the format's description. It has spacing and position, and no orientation of a patient:
taken as axial, as slices and npy are. Of several channels one is read, chosen as a series; labels are in `labels/`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError
from ...core.volume import ValueKind
from ..file_formats import natural_key
from ..geometry import AXIAL, taken_as_axial, turned_notes
from ..labels.colors import RGB
from ..labels.label_map import clean_name
from ..length_units import in_mm
from ..result import RawValues, ReadRequest, VolumeSource
from ..series import Series
from .zarr_array import ArrayHeader, ZarrSlices, array_header, listed, missing_note, read_json

VERSIONS = ("0.4", "0.5")
MOST_LEVELS, MOST_CHANNELS = 64, 1000
MOST_NAMED = 5  # A message names at most this many.
NAME_KEYS = ("name", "label-name", "label_name", "class", "label")  # A label's properties may have any of these.


class _Multiscale(NamedTuple):
    """The image of a group: its axes, and an array for each resolution."""

    axes: list[dict[str, Any]]
    levels: list[ArrayHeader]
    transforms: list[list[Any]]  # Transforms of each level: its own, then those of all levels.
    labels: dict[str, Any] | None  # `image-label`; None where it is an image
    notes: tuple[str, ...]

    def axis(self, kind: str, name: str) -> int | None:
        """Return the number of the axis of that type, or of that name if it has no type; None without such an axis."""
        for number, axis in enumerate(self.axes):
            if axis.get("type", "") == kind or (not axis.get("type") and axis.get("name") == name):
                return number
        return None

    @property
    def space(self) -> tuple[int, int, int]:
        """Return the numbers of the axes z, y and x: by their names, else the last three."""
        names = [str(axis.get("name", "")).lower() for axis in self.axes]
        last = len(self.axes)
        if all(names.count(letter) == 1 for letter in "zyx"):
            return (names.index("z"), names.index("y"), names.index("x"))
        return (last - 3, last - 2, last - 1)


class _OmeZarr(VolumeSource):
    """One image or label group."""

    format = "OME-Zarr"
    has_geometry = True

    def __init__(self, path: Path, image: _Multiscale, label_groups: Sequence[str], channels: Sequence[str]) -> None:
        self.image, self.channels = image, list(channels)
        full = image.levels[0]
        z, y, x = image.space
        time = image.axis("time", "t")
        size, times = (full.shape[x], full.shape[y]), 1 if time is None else full.shape[time]
        series = tuple(
            Series(number, "", full.shape[z], size, "", full.dtype.name, times, description=name)
            for number, name in enumerate(channels, 1)
        )
        super().__init__(path, series, ())
        self.has_series = len(series) > 1
        self.label_groups = tuple(label_groups)
        self.levels = tuple((level.shape[x], level.shape[y], level.shape[z]) for level in image.levels)

    @property
    def files(self) -> tuple[Path, ...]:
        """Return all metadata and chunks, which are looked for when they are asked for."""
        paths = (Path(folder) / file for folder, _, files in os.walk(self.path) for file in files)
        return tuple(sorted(paths, key=natural_key))

    def selected_series(self, series: str | int | None) -> Series | None:
        """Return the channel that would be read; by default the first."""
        word = "" if series is None else str(series).strip()
        return next((line for line in self.series if word in ("", str(line.number))), None)

    def raw_values(self, request: ReadRequest) -> RawValues:
        """Return the values of one level, time and channel."""
        channel = self.selected_series(request.series)
        if channel is None:
            raise ReadError(
                f"there is no series '{request.series}', because {self.path.name} has {len(self.series)} channels; "
                f"choose from 1 to {len(self.series)}"
            )
        header = self.image.levels[request.level]
        at = {number: 0 for number in range(len(header.shape)) if number not in self.image.space}
        for number, index in ((self.image.axis("time", "t"), request.time), (self._channel_axis, channel.number)):
            if number is not None and index > header.shape[number]:
                raise ReadError(f"{header.name} has fewer times or channels than level 0; export it again")
            if number is not None:
                at[number] = index - 1
        sides = " x ".join(str(header.chunks[axis]) for axis in reversed(self.image.space))
        what = f"reading one chunk of {header.name} ({sides})"
        request.budget.require(header.chunk_bytes, what, "save it with smaller chunks")
        reader = ZarrSlices(header, self.image.space, at)
        affine, notes = self._placed(request.level)
        notes += missing_note(header, reader.array.fill_value)
        if len(self.series) > 1 and not request.series:
            count = len(self.series)
            notes.append(f"{count} channels found: channel 1 was read; give its number as the series, 1 to {count}")
        names, colors = _label_facts(self.image.labels or {})
        kind = None if self.image.labels is None else ValueKind.LABEL
        return RawValues(reader, affine, (*self.image.notes, *notes), kind, names, colors, directions=AXIAL)

    @property
    def _channel_axis(self) -> int | None:
        return self.image.axis("channel", "c")

    def _placed(self, level: int) -> tuple[NDArray[np.float64] | None, list[str]]:
        """Return the affine to RAS+ mm and the assumptions; None without a scale."""
        name = self.image.levels[level].name
        lengths, shifts, is_scaled = _scale_and_shift(self.image.transforms[level], len(self.image.axes), name)
        if not is_scaled:
            return None, []
        space = self.image.space[::-1]
        words = [self.image.axes[axis].get("unit") for axis in space]
        units = ["" if word is None else str(word).strip() for word in words]
        lengths_mm, unit_notes = in_mm(units)
        affine = np.eye(4)
        affine[:3, :3] = AXIAL * lengths[list(space)] * lengths_mm
        affine[:3, 3] = AXIAL.diagonal() * shifts[list(space)] * lengths_mm + 0.0
        notes = [taken_as_axial(self.format), *turned_notes("scales", lengths[list(space)])]
        if "" in units:
            notes.append("the file's axes have no unit: taken as mm; give the spacing in mm for another")
        return affine, [*notes, *unit_notes]


def open_source(path: Path) -> _OmeZarr:
    """Read the metadata of an image or of labels, and of all its resolutions."""
    if not path.is_dir():
        raise ReadError(f"{path.name} is a file, and an OME-Zarr is a folder; unpack it, and choose the folder")
    folder = image_folder(path)
    about = _ome_of(folder)
    image = _multiscale(folder, about, path.name)
    channel_axis = image.axis("channel", "c")
    count = 1 if channel_axis is None else image.levels[0].shape[channel_axis]
    if count > MOST_CHANNELS:
        raise ReadError(f"{path.name} has {count} channels, and at most {MOST_CHANNELS} are read; save one of them")
    labels = [f"labels/{word}" for word in listed(_ome_of(folder / "labels"), "labels") if _is_inner(word)]
    before = f"{folder.relative_to(path).as_posix()}/" if folder != path else ""
    return _OmeZarr(path, image, [before + word for word in labels], _channel_names(about, count))


def _ome_of(folder: Path) -> dict[str, Any]:
    """Return the OME-Zarr attributes of a group: all attributes in 0.4, those below `ome` in 0.5."""
    third = read_json(folder / "zarr.json", folder.name)
    attributes = third.get("attributes") if third else read_json(folder / ".zattrs", folder.name)
    if not isinstance(attributes, dict):
        return {}
    ome = attributes.get("ome", attributes)
    return ome if isinstance(ome, dict) else {}


def image_folder(path: Path) -> Path:
    """Return the folder itself, or that of its only image, as bioformats2raw writes it; else raise `ReadError`."""
    about = _ome_of(path)
    if listed(about, "multiscales"):
        return path
    if _is_array(path):
        raise ReadError(
            f"{path.name} is one array of a Zarr store without OME-Zarr metadata; choose the folder that holds "
            f"it, {path.absolute().parent.name}, and the level"
        )
    inner = [f"labels/{word}" for word in listed(_ome_of(path / "labels"), "labels") if _is_inner(word)]
    inner += [str(word) for word in listed(about, "labels") if _is_inner(word)]
    inner += sorted(entry.name for entry in path.iterdir() if entry.is_dir() and listed(_ome_of(entry), "multiscales"))
    if "plate" in about or "well" in about:
        what = "a plate of many images"
        inner = [str(image["path"]) for image in images_of(about) if _is_inner(image.get("path"))] or inner
    elif len(inner) == 1 and "labels" not in about:
        return path / inner[0]
    else:
        what = "a Zarr store without an image of OME-Zarr (multiscales)"
    words = [f"{path.name}/{word}" for word in dict.fromkeys(inner)][:MOST_NAMED]
    hint = f"choose {' or '.join(words)}" if words else "choose an image"
    raise ReadError(f"{path.name} is {what}; {hint}")


def images_of(about: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the images of a well."""
    well = about.get("well")
    return [image for image in listed(well, "images") if isinstance(image, dict)] if isinstance(well, dict) else []


def _is_array(folder: Path) -> bool:
    """Return whether a folder is an array, and not a group of some."""
    return (folder / ".zarray").is_file() or read_json(folder / "zarr.json", folder.name).get("node_type") == "array"


def _is_inner(word: Any) -> bool:
    """Return whether a path in metadata leads to a folder within their own."""
    if not isinstance(word, str) or "\0" in word or "\\" in word or ":" in word:
        return False
    inner = PurePosixPath(word)
    return bool(inner.parts) and not inner.is_absolute() and ".." not in inner.parts


def _multiscale(folder: Path, about: Mapping[str, Any], name: str) -> _Multiscale:
    """Return the first image in the metadata of a group."""
    images = about["multiscales"]
    first = images[0] if isinstance(images[0], dict) else {}
    version = str(about.get("version", first.get("version", _version_by_axes(first))))
    if not version.startswith(VERSIONS):
        raise ReadError(
            f"{name} is OME-Zarr {version[:20]}, and {' and '.join(VERSIONS)} are read; write it again as one of them, "
            "which ome-zarr-py and bioformats2raw from 0.5 on do"
        )
    axes = listed(first, "axes")
    datasets = listed(first, "datasets")
    if not axes or not all(isinstance(axis, dict) for axis in axes) or not 1 <= len(datasets) <= MOST_LEVELS:
        raise ReadError(
            f"{name} has {len(axes)} axes and {len(datasets)} resolutions that can be read; export it again"
        )
    levels, transforms = [], []
    for number, dataset in enumerate(datasets):
        inner = dataset.get("path") if isinstance(dataset, dict) else None
        if inner is None or not _is_inner(inner):
            raise ReadError(
                f"{name} has no array of its own for level {number}, but '{str(inner)[:60]}'; export it again"
            )
        if not (folder / inner).resolve().is_relative_to(folder.resolve()):
            raise ReadError(f"level {number} of {name} is a link out of its folder; copy the array into the store")
        header = array_header(folder / inner, f"level {number} of {name}")
        if len(header.shape) != len(axes):
            raise ReadError(
                f"{header.name} has {len(header.shape)} axes, and its metadata name {len(axes)}; export it again"
            )
        levels.append(header)
        transforms.append([*listed(dataset, "coordinateTransformations"), *listed(first, "coordinateTransformations")])
    labels = about.get("image-label")
    labels = labels if isinstance(labels, dict) else {} if folder.parent.name == "labels" else None
    notes = (f"{len(images) - 1} further images of the group left out",) if len(images) > 1 else ()
    image = _Multiscale(axes, levels, transforms, labels, notes)
    _check_axes(image)
    return image


def _version_by_axes(multiscales: Mapping[str, Any]) -> str:
    """Return the version of metadata that name none: axes came with 0.3, as words, and are objects since 0.4."""
    if "axes" not in multiscales and listed(multiscales, "datasets"):
        return "0.2 or older"
    axes = listed(multiscales, "axes")
    return "0.3" if axes and all(isinstance(axis, str) for axis in axes) else VERSIONS[0]


def _check_axes(image: _Multiscale) -> None:
    """Refuse what is not a volume at times and of channels."""
    space = set(image.space)
    handled_axes = space | {image.axis("time", "t"), image.axis("channel", "c")}
    words = " ".join(str(axis.get("name", "?"))[:20] for axis in image.axes)
    is_flat = len(image.axes) < 3 or any(image.axes[axis].get("type") in ("time", "channel") for axis in space)
    for header in image.levels:
        if is_flat or header.shape[image.space[0]] < 2:
            raise ReadError(f"{header.name} has only one slice (axes {words}); a surface needs at least 2 slices")
        for number, side in enumerate(header.shape):
            if side > 1 and number not in handled_axes:
                raise ReadError(
                    f"{header.name} has {side} volumes along an axis of its own (axes {words}); save one of them"
                )


def _scale_and_shift(
    transforms: Sequence[Any], axes: int, name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], bool]:
    """Return sample length and position of the first sample along each axis, (axes,), and whether there is a scale."""
    lengths, shifts, is_scaled = np.ones(axes), np.zeros(axes), False
    for transform in transforms:
        about = transform if isinstance(transform, dict) else {}
        kind = about.get("type")
        if kind == "identity":
            continue
        numbers = about.get(str(kind))
        is_list = isinstance(numbers, list) and len(numbers) == axes
        if kind not in ("scale", "translation") or not is_list or not all(map(is_number, numbers or ())):
            raise ReadError(
                f"{name} has the transformation {str(transform)[:80]}, which is not a scale or a translation of {axes} "
                "numbers; export it again"
            )
        values = np.array(numbers, np.float64)
        if kind == "scale":
            lengths, shifts, is_scaled = lengths * values, shifts * values, True
        else:
            shifts = shifts + values
    return lengths, shifts, is_scaled


def is_number(value: Any) -> bool:
    """Return whether a value of the metadata is a number of a size that occurs."""
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e30 and not math.isnan(value)
    )


def _channel_names(about: Mapping[str, Any], count: int) -> list[str]:
    """Return the channels' labels of `omero`, empty where there are none."""
    omero = about.get("omero")
    channels = listed(omero, "channels") if isinstance(omero, dict) else []
    words = [channel.get("label", "") if isinstance(channel, dict) else "" for channel in channels]
    names = [clean_name(word, "") if isinstance(word, str) else "" for word in words]
    return names if len(names) == count else [""] * count


def _label_facts(about: Mapping[str, Any]) -> tuple[dict[int, str], dict[int, RGB]]:
    """Return names and colors of labels in `image-label`, without broken ones: the labels are readable without.

    Examples
    --------
    >>> about = {"colors": [{"label-value": 1, "rgba": [255, 0, 9, 255]}]}
    >>> _label_facts(about | {"properties": [{"label-value": 1, "name": "liver"}]})
    ({1: 'liver'}, {1: (255, 0, 9)})
    """
    names: dict[int, str] = {}
    colors: dict[int, RGB] = {}
    for entry in [*listed(about, "colors"), *listed(about, "properties")]:
        label = entry.get("label-value") if isinstance(entry, dict) else None
        if type(label) is not int or not label:
            continue
        rgba = entry.get("rgba")
        if isinstance(rgba, list) and len(rgba) == 4 and all(type(part) is int and 0 <= part <= 255 for part in rgba):
            colors[label] = (rgba[0], rgba[1], rgba[2])
        word = next((entry[key] for key in NAME_KEYS if isinstance(entry.get(key), str)), "")
        if word.strip():
            names[label] = clean_name(word, f"label {label}")
    return names, colors
