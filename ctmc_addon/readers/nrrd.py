"""NRRD with its data inside, in one other file or in many: pynrrd reads the header, the values come straight in.

The first axis is the fastest, so the values are (third, second, first) in C order. The named spaces
are turned to RAS+ mm. teem.sourceforge.net/nrrd/format.html is the format's description.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..core import ReadError, Step, Steps, within
from .file_formats import natural
from .optional_imports import BROKEN, needed, quiet, reason
from .result import Reading, Series
from .streams import check_end, fill_steps, skip, unpacked
from .value_kind import native_steps, require_memory

WHAT = "NRRD"
# Signs that turn a named space's axes to right, anterior, superior.
SPACES = {
    "right-anterior-superior": (1.0, 1.0, 1.0),
    "left-anterior-superior": (-1.0, 1.0, 1.0),
    "left-posterior-superior": (-1.0, -1.0, 1.0),
    "ras": (1.0, 1.0, 1.0),
    "las": (-1.0, 1.0, 1.0),
    "lps": (-1.0, -1.0, 1.0),
}
TYPES = {
    "i1": ("signed char", "int8", "int8_t"),
    "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"),
    "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "i8": ("longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"),
    "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "f4": ("float",),
    "f8": ("double",),
}
WORDS_CHUNK = 2**17  # bytes of numbers in words, about 0.005 s
TO_MM = {"mm": 1.0, "millimeter": 1.0, "um": 0.001, "µm": 0.001, "micron": 0.001, "cm": 10.0, "m": 1000.0}


def read_steps(path: Path) -> Steps[Reading]:
    """Read one `.nrrd`, or one `.nhdr` with the data it names."""
    with path.open("rb") as stream:
        header = read_header(stream, path.name)
        size, kept = checked_size(header, path.name)
        dtype = checked_dtype(header, path.name)
        require_memory(size[::-1], dtype.itemsize, path.name)
        files = data_files(header, path)
        values = np.empty(size[::-1], dtype)
        if not files:
            yield from values_steps(values, stream, header, path)
    share = max(1, len(values) // max(1, len(files)))  # slices in each data file
    if files and share * len(files) != len(values):
        raise ReadError(f"{path.name} names {len(files)} data files for {len(values)} slices; repair the header")
    for number, file in enumerate(files):
        if not file.is_file():
            raise ReadError(f"{path.name} names the data file {file.name}, which is missing; keep the two together")
        with file.open("rb") as stream:
            part = values_steps(values[number * share : (number + 1) * share], stream, header, file)
            yield from within(part, number / len(files), (number + 1) / len(files))
    affine, notes = placed(header, kept)
    values = yield from native_steps(values)
    return Reading(values, affine, notes, "", label_names(header), WHAT)


def describe(path: Path) -> Series:
    """Size of the volume, from the header alone."""
    with path.open("rb") as stream:
        (columns, rows, slices), _ = checked_size(read_header(stream, path.name), path.name)
    return Series(1, "", slices, (columns, rows))


def read_header(stream: IO[bytes], name: str) -> Mapping[str, Any]:
    """Header by pynrrd; `stream` is left at the first byte of attached data."""
    nrrd = needed("nrrd", "pynrrd", WHAT)
    lines, names = header_lines(stream)
    if not lines:
        raise ReadError(f"{name} is no NRRD file: it does not begin with 'NRRD'; export or copy it again")
    try:
        with quiet():
            header = dict(nrrd.read_header(lines))
    except (*BROKEN, nrrd.NRRDError, StopIteration) as error:
        raise ReadError(f"{name} is no readable NRRD file ({reason(error)}); export or copy it again") from error
    if names:
        header["data file"] = names
    for field in ("type", "dimension", "sizes", "encoding"):
        if field not in header:
            raise ReadError(f"{name} lacks the field '{field}' in its header; export it again")
    if header["dimension"] != len(header["sizes"]):
        raise ReadError(
            f"{name} has {header['dimension']} dimensions but {len(header['sizes'])} sizes; export it again"
        )
    return header


def header_lines(stream: IO[bytes]) -> tuple[list[bytes], list[str]]:
    """Lines up to the empty one, and the names that follow `data file: LIST`, which pynrrd does not know."""
    if stream.read(4) != b"NRRD":
        return [], []
    lines, names = [b"NRRD" + stream.readline()], []
    listing = False
    while line := stream.readline().strip(b"\r\n"):
        if listing:
            names.append(line.decode("utf-8", "replace").strip())
        elif re.match(rb"data ?file:\s*LIST", line, re.IGNORECASE):
            listing = True
        else:
            lines.append(line)
    return lines, names


def checked_size(header: Mapping[str, Any], name: str) -> tuple[tuple[int, int, int], list[int]]:
    """Size along the three axes of space, and which axes those are; a `ReadError` if it is not one volume."""
    sizes = [int(side) for side in header["sizes"]]
    kept = [axis for axis, side in enumerate(sizes) if side > 1 or len(sizes) <= 3]
    if min(sizes) < 1 or len(kept) > 3:
        kinds = " ".join(header.get("kinds", ()))
        raise ReadError(
            f"{name} has the sizes {tuple(sizes)}{f' ({kinds})' if kinds else ''}, and a volume has 3; "
            "save one time point, channel or label layer as a file of its own"
        )
    kinds = header.get("kinds", [])
    colour = [kind for kind in kinds if "color" in str(kind).lower() or "vector" in str(kind).lower()]
    if len(kept) == 3 and colour:
        raise ReadError(f"{name} has {colour[0]} voxels; convert it to grey values or labels (one number a voxel)")
    if len(kept) < 3 or sizes[kept[2]] < 2:
        raise ReadError(f"{name} holds one slice only, sizes {tuple(sizes)}; a surface needs at least 2 slices")
    return (sizes[kept[0]], sizes[kept[1]], sizes[kept[2]]), kept


def checked_dtype(header: Mapping[str, Any], name: str) -> np.dtype[Any]:
    """The type of the values in the file, with its byte order."""
    word = str(header["type"]).strip().lower()
    code = next((code for code, words in TYPES.items() if word in words), None)
    if code is None:
        raise ReadError(f"{name} has values of type '{word}'; convert it to short or float")
    endian = str(header.get("endian", "little")).lower()
    return np.dtype((">" if endian == "big" else "<") + code)


def data_files(header: Mapping[str, Any], path: Path) -> list[Path]:
    """The files that hold the values, in order; none where they follow the header.

    `data file` is a name, a list under `LIST`, or a pattern `name%d first last step [dimension]`.
    """
    named = header.get("data file", header.get("datafile", []))
    names: list[str] = [named] if isinstance(named, str) else named
    pattern = re.fullmatch(r"(.*%\d*d.*?)\s+(-?\d+)\s+(-?\d+)\s+(-?\d+)(?:\s+\d+)?", names[0]) if names else None
    if pattern and int(pattern[4]):
        first, last, step = (int(pattern[group]) for group in (2, 3, 4))
        names = [pattern[1] % number for number in range(first, last + (1 if step > 0 else -1), step)]
    return [Path(os.path.normpath(path.parent / name.replace("\\", "/"))) for name in names]


def values_steps(values: NDArray[Any], stream: IO[bytes], header: Mapping[str, Any], path: Path) -> Steps[None]:
    """Fill `values` from `stream` by the header's encoding and skips."""
    encoding = str(header["encoding"]).lower()
    for _ in range(int(header.get("line skip", header.get("lineskip", 0)))):
        stream.readline()
    byte_skip = int(header.get("byte skip", header.get("byteskip", 0)))
    if encoding == "raw":
        if byte_skip < 0:  # -1: the values are the file's last bytes
            stream.seek(max(0, path.stat().st_size - values.nbytes))
        else:
            skip(stream, byte_skip, path.name)
        yield from fill_steps(values, stream, path.name)
    elif encoding in ("gzip", "gz", "bzip2", "bz2"):
        with unpacked(stream, encoding) as plain:
            skip(plain, max(0, byte_skip), path.name)
            yield from fill_steps(values, plain, path.name)
            check_end(plain, path.name)
    elif encoding in ("ascii", "text", "txt"):
        yield from words_steps(values.reshape(-1), stream, path.name)
    else:
        raise ReadError(f"{path.name} is encoded as '{encoding}'; save it as raw or gzip")


def words_steps(values: NDArray[Any], stream: IO[bytes], name: str) -> Steps[None]:
    """Fill `values` (n,) from numbers in words; too few, too many and other words are a `ReadError`."""
    done, rest, more = 0, b"", True
    while more:
        yield Step(min(1.0, done / len(values)), f"Reading {name}")
        piece = stream.read(WORDS_CHUNK)
        more = bool(piece)
        words = (rest + piece).split()
        rest = words.pop() if words and more and not piece[-1:].isspace() else b""  # the next piece may go on with it
        end = done + len(words)
        if end < len(values) and not more:
            raise ReadError(f"{name} is truncated: {end} of {len(values)} values are there; copy it again")
        if end > len(values):
            raise ReadError(f"{name} holds more than the {len(values)} values of its sizes; repair the header")
        try:
            values[done:end] = np.array(words, dtype="S").astype(values.dtype)
        except ValueError as error:
            raise ReadError(f"{name} has a value that is no number ({reason(error)}); export it again") from error
        done = end


def placed(header: Mapping[str, Any], kept: list[int]) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
    """Affine to RAS+ mm and what was assumed; a file without directions is taken as axial."""
    space = str(header.get("space", "")).strip().lower()
    if "space directions" in header:
        directions = np.asarray(header["space directions"], np.float64)
        origin = np.asarray(header.get("space origin", (0.0, 0.0, 0.0)), np.float64)
        if directions.ndim != 2 or directions.shape[1] != 3 or len(directions) <= max(kept) or origin.shape != (3,):
            raise ReadError(
                f"'space directions' {directions.shape} and 'space origin' {origin.shape} of the NRRD do not place "
                "three axes in space; export it again"
            )
        affine = np.eye(4)
        affine[:3, :3] = directions[kept].T
        affine[:3, 3] = origin
        notes = []
        signs = SPACES.get(space.removesuffix("-time"))
        if signs is None:
            signs = (1.0, 1.0, 1.0)
            notes.append(
                f"the file's space '{space or 'none'}' names no side of the patient: taken as right-anterior-superior"
            )
        affine[:3] *= np.array(signs)[:, None]
        units = {str(unit).strip('" ').lower() for unit in header.get("space units", ())}
        if len(units) == 1 and TO_MM.get(min(units), 1.0) != 1.0:
            affine[:3] *= TO_MM[min(units)]
            notes.append(f"the file's positions are in {min(units)} and were converted to mm")
        return affine, tuple(notes)
    spacings = np.asarray(header.get("spacings", ()), np.float64)
    if len(spacings) <= max(kept) or not np.isfinite(spacings[kept]).all():
        return None, ()
    affine = np.diag([-spacings[kept[0]], -spacings[kept[1]], spacings[kept[2]], 1.0])
    return affine, (
        "the NRRD has spacings but no orientation: taken as axial, columns towards the patient's left, "
        "rows towards the back, slices towards the head; flip x, y or z changes it",
    )


def label_names(header: Mapping[str, Any]) -> dict[int, str]:
    """Names of labels from Slicer's keys `SegmentN_LabelValue` and `SegmentN_Name`."""
    names: dict[int, str] = {}
    for key in sorted(header, key=lambda key: natural(Path(key))):
        found = re.fullmatch(r"Segment(\d+)_LabelValue", key)
        if found and str(header[key]).strip().isdigit():
            names[int(header[key])] = str(header.get(f"Segment{found[1]}_Name", f"Segment {found[1]}"))
    return names
