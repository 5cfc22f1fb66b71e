# SPDX-License-Identifier: GPL-3.0-or-later
"""Every remedy that a refusal names works: the flags in its sentence are tried, one after the other.

A row has a command that is refused and, for each flag of the sentence, the words behind it; None leaves it out.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import pytest
import zarr_stores
from volumes import AFFINE

VALUES = np.random.default_rng(0).integers(0, 500, (8, 7, 6)).astype(np.int16)
BALL = np.where(sum((axis - 6) ** 2 for axis in np.indices((13, 13, 13))) <= 16, 200, 0).astype(np.int16)
VERBS = r"\b(?:set|give|choose|lower|use|leave)\b"
OPTIONS = {"spacing": "--spacing", "minimum volume": "--min-part", "series": "--series", "threshold": "--threshold"}
OPTIONS |= {"level": "--level", "larger stride": "--stride"}


def named_flags(sentence):
    """The flags that a sentence names, by themselves or as an option behind a verb in its remedy."""
    remedy = sentence.rpartition(";")[2]
    flags = set(re.findall(r"--[a-z][a-z-]*", sentence))
    return flags | {flag for word, flag in OPTIONS.items() if re.search(rf"{VERBS}[^;]*\b{word}\b", remedy)}


def with_flag(words, flag, values):
    """The command with a flag and its values, which take the place of those that it had; None leaves it out."""
    for value in values or ():
        if value.startswith("without "):
            words = with_flag(words, value.removeprefix("without "), None)
    values = None if values is None else [value for value in values if not value.startswith("without ")]
    kept, passing = [], False
    for word in words:
        passing = word == flag or (passing and not str(word).startswith("--"))
        if not passing:
            kept.append(word)
    return kept if values is None else [*kept, flag, *values]


def npy(folder, values=BALL):
    np.save(folder / "ct.npy", values)
    return folder / "ct.npy"


def metaimage(folder, extra="", data="LOCAL"):
    head = f"NDims = 3\nDimSize = 6 7 8\nElementType = MET_SHORT\n{extra}ElementDataFile = {data}\n"
    (folder / "ct.mha").write_bytes(head.encode() + VALUES.tobytes())
    return folder / "ct.mha"


def flat_metaimage(folder):
    return metaimage(folder, "ElementSpacing = 1 1 0\n")


def flat_nrrd(folder, *lines):
    lines = lines or ("spacings: 1 0 2",)
    head = [
        "NRRD0005",
        "type: short",
        "endian: little",
        "dimension: 3",
        "sizes: 6 7 8",
        "encoding: raw",
        *lines,
        "",
        "",
    ]
    (folder / "ct.nrrd").write_bytes("\n".join(head).encode() + VALUES.tobytes())
    return folder / "ct.nrrd"


def flat_directions(folder):
    return flat_nrrd(folder, "space: left-posterior-superior", "space directions: (1,0,0) (0,1,0) (0,0,0)")


def nifti(folder, **fields):
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.Nifti1Image(VALUES.T, np.eye(4))
    header = image.header.copy()
    header["vox_offset"], header["magic"] = 352, b"n+1"
    for name, value in fields.items():
        header[name] = value
    (folder / "ct.nii").write_bytes(header.binaryblock + bytes(4) + VALUES.tobytes())
    return folder / "ct.nii"


def flat_nifti(folder):
    return nifti(folder, srow_z=0)


def nifti_without_a_place(folder):
    return nifti(folder, srow_x=0, srow_y=0, srow_z=0)


def flat_mgh(folder):
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.MGHImage(VALUES.T, np.eye(4)), folder / "ct.mgh")
    content = bytearray((folder / "ct.mgh").read_bytes())
    content[30:42] = np.array([1, 1, 0], ">f4").tobytes()  # delta
    (folder / "ct.mgh").write_bytes(content)
    return folder / "ct.mgh"


def store(folder, scale=(2, 1, 1), **options):
    pytest.importorskip("zarr")
    about = zarr_stores.multiscales("0.4", **options)
    for dataset in about["datasets"]:
        dataset["coordinateTransformations"] = [{"type": "scale", "scale": scale}]
    return zarr_stores.save_by_hand(folder / "ct.ome.zarr", VALUES, VALUES.shape, attrs={"multiscales": [about]})


def flat_store(folder):
    return store(folder, (0, 1, 1))


def dicom(folder, change):
    pydicom = pytest.importorskip("pydicom")
    from ctmc_addon.cli import main

    assert main(["phantom", str(folder / "phantom"), "--slices", "4", "--size", "16", "--quiet"]) == 0
    for path in (folder / "phantom" / "dicom").iterdir():
        dataset = pydicom.dcmread(path)
        change(dataset)
        dataset.save_as(path)
    return folder / "phantom" / "dicom"


def flat_dicom(folder):
    return dicom(folder, lambda dataset: setattr(dataset, "PixelSpacing", [0, 0]))


def dicom_without_spacing(folder):
    return dicom(folder, lambda dataset: delattr(dataset, "PixelSpacing"))


def far_data(folder):
    (folder / "data").mkdir()
    (folder / "data" / "ct.raw").write_bytes(VALUES.tobytes())
    (folder / "headers").mkdir()
    return metaimage(folder / "headers", data="../data/ct.raw")


def with_nan(folder):
    values = BALL.astype(np.float32)
    values[0, 0, 0] = np.nan
    return npy(folder, values)


def one_label(folder):
    return npy(folder, np.ones((6, 6, 6), np.uint8)).rename(folder / "segmentation.npy")


def hounsfield(folder):
    return nifti_of(folder, BALL - 1000)


def nifti_of(folder, values):
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Image(values.T, AFFINE), folder / "ct.nii")
    return folder / "ct.nii"


def earlier_batch(folder):
    (folder.parent / "out" / "summary.csv").write_text("")
    return npy(folder)


def segmented(folder):
    from ctmc_addon.cli import main

    path, words = npy(folder), ["--method", "connected", "--range", "100", "300", "--seed", *SEED, "--quiet"]
    assert main(["segment", str(path), "-o", str(folder / "drawn.seg.nrrd"), *words]) == 0
    return path


class Row(NamedTuple):
    make: object
    words: str
    """The command; INPUT, its folder IN and OUT are put in."""
    remedies: dict


INFO, SURFACE = "info INPUT", "reconstruct INPUT -o OUT/x.stl --quiet"
SEGMENT = "segment INPUT -o OUT/l.seg.nrrd --quiet --method connected"
SEED, DRAWN = ["ball", "-6", "-6", "6"], "IN/drawn.seg.nrrd"
SPACING = {"--spacing": ["1", "1", "2"]}
ROWS = [
    *(
        Row(make, words, SPACING)
        for make in (
            *(flat_metaimage, flat_nrrd, flat_directions, flat_nifti, nifti_without_a_place, flat_mgh, flat_store),
            *(flat_dicom, dicom_without_spacing),
        )
        for words in (INFO, f"{SURFACE} --threshold 100")
    ),
    Row(far_data, INFO, {"--allow-outside": []}),
    Row(with_nan, f"{SURFACE} --threshold 50", {"--nan-as": ["0"]}),
    Row(one_label, f"{SURFACE} --label 1", {"--close-border": []}),
    Row(hounsfield, f"{SURFACE} --label 1", {"--threshold": ["-900", "without --label"]}),
    Row(npy, f"{SURFACE} --threshold 100 --min-part 1e6", {"--min-part": ["1"]}),
    Row(npy, f"{INFO} --remove-table", {"--remove-table": None}),
    Row(npy, f"{SURFACE} --threshold 100 --series 2", {"--series": None}),
    Row(npy, f"{SURFACE} --threshold 100 --level 1", {"--level": None}),
    Row(npy, "measure INPUT --threshold 100 --simplify 0.5 --simplifier decimate", {"--simplifier": None}),
    Row(npy, "reconstruct INPUT -o OUT/t/ --quiet --threshold 100 --time all", {"--time": None}),
    Row(
        segmented,
        f"{SEGMENT} --range 100 300",
        {"--seed": SEED, "--from": [DRAWN, "--margin", "ball", "2"], "--margin": ["ball", "2", "--from", DRAWN]},
    ),
    Row(npy, f"{SEGMENT} --seed ball -6 -6 6", {"--range": ["100", "300"]}),
    Row(npy, f"{SEGMENT} --seed -6 -6 6 --range 100 300", {"--seed": SEED}),
    Row(earlier_batch, "batch INPUT -o OUT --threshold 100 --quiet", {"--resume": [], "--overwrite": []}),
]


def put_in(words, folder, path=""):
    """The words with their paths."""
    places = {"INPUT": str(path), "IN/": f"{folder / 'in'}/", "OUT": str(folder / "out")}
    for name, place in places.items():
        words = [word.replace(name, place) for word in words]
    return words


def row_name(row):
    return f"{row.make.__name__}, {row.words.partition(' ')[0]}"


@pytest.mark.parametrize("row", ROWS, ids=row_name)
def test_each_flag_that_a_refusal_names_mends_it(ctmc, tmp_path, row):
    for name in ("in", "out"):
        (tmp_path / name).mkdir()
    words = put_in(row.words.split(), tmp_path, row.make(tmp_path / "in"))
    outcome = ctmc(*words)
    assert outcome.code in (1, 2), outcome.out
    sentence = outcome.errors[-1]
    named = named_flags(sentence)
    assert set(row.remedies) <= named <= {*row.remedies, *words}, sentence
    for flag, values in row.remedies.items():
        outcome = ctmc(*with_flag(words, flag, None if values is None else put_in(values, tmp_path)))
        assert outcome.code == 0, outcome.errors
