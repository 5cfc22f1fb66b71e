# SPDX-License-Identifier: GPL-3.0-or-later
"""Every remedy that a refusal names works: the flags in its sentence are tried, one after the other.

A row has a command that is refused and, for each flag of the sentence, the words behind it; None leaves it out.
"""

from __future__ import annotations

import importlib.util
import re
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
import zarr_stores
from volumes import AFFINE

pytestmark = pytest.mark.once

VALUES = np.random.default_rng(0).integers(0, 500, (8, 7, 6)).astype(np.int16)
BALL = np.where(sum((axis - 6) ** 2 for axis in np.indices((13, 13, 13))) <= 16, 200, 0).astype(np.int16)
VERBS = r"\b(?:set|give|choose|lower|use|leave)\b"
OPTIONS = {"spacing": "--spacing", "minimum volume": "--min-part", "series": "--series", "threshold": "--threshold"}
OPTIONS |= {"level": "--level", "larger stride": "--stride", "one time": "--time", "transparency": "--transparent"}
OPTIONS |= {"width": "--width-mm", "columns": "--columns", "height": "--height-mm"}


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


def two_labels(folder):
    values = (BALL > 0).astype(np.uint8)
    values[6:] *= 2
    return nifti_of(folder, values).rename(folder / "segmentation-1.nii")


def four_times(folder):
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Image(np.stack([BALL.T, BALL.T], axis=-1), np.eye(4)), folder / "ct.nii")
    return folder / "ct.nii"


def figures():
    pytest.importorskip("bpy", reason="the Python package bpy is not installed")
    pytest.importorskip("PIL.Image")


def rendered(folder):
    figures()
    return npy(folder)


def rendered_labels(folder):
    figures()
    return two_labels(folder)


def mesh_file(folder):
    from ctmc_addon.cli import main

    assert main(["reconstruct", str(rendered(folder)), "-o", str(folder / "a.stl"), "--threshold", "100"]) == 0
    return folder / "a.stl"


def earlier_video(folder):
    (folder.parent / "out" / "t.mp4").write_bytes(b"a video")
    return rendered(folder)


def earlier_frames(folder):
    from ctmc_addon.cli import main

    path = rendered(folder)
    assert main(put_in(TURNTABLE.split(), folder.parent, path)) == 0
    return path


def earlier_experiment(folder):
    (folder.parent / "out" / "alpha.csv").write_text("")
    return rendered(folder)


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
FIGURE = "INPUT -o OUT/a.png --no-blend --dpi 40 --style clinical"
SHEET = f"figure sheet {FIGURE} --threshold 100 --strides 1 2 3"
COLORED = f"figure {FIGURE} --threshold 100 --deviation"
TURNTABLE = "figure turntable INPUT --threshold 100 --no-blend --dpi 40 --style clinical --seconds 1 --fps 3 -o OUT/t"
ALPHA = "experiment alpha INPUT -o OUT --no-pictures --alphas 0 1"
TURNING = "experiment rotation INPUT -o OUT --step 180 --resolution 16 16"
DECIMATE = "--simplify 0.5 --simplifier decimate"
TIMES, STLS = "reconstruct INPUT -o OUT/a/ --time all --quiet", "reconstruct INPUT -o OUT/t/ --quiet"
INSTEAD = ["-o", "OUT/a.stl", "without -o"]  # of the picture
ADDRESS = "tcp://127.0.0.1:1"
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
    Row(two_labels, "batch INPUT -o OUT --label 9 --strict --overwrite --quiet", {"--strict": None}),
    Row(four_times, f"{TIMES} --threshold 100 --figure OUT/a.png", {"--figure": None}),
    Row(four_times, f"{TIMES} --threshold 100 --scheduler {ADDRESS}", {"--scheduler": None}),
    Row(four_times, f"{TIMES} --label all", {"--time": ["1", "--threshold", "100", "without --label"]}),
    Row(two_labels, f"{STLS} --label 1 2 --scheduler {ADDRESS}", {"--scheduler": None}),
    Row(rendered, "reconstruct INPUT --threshold 100 --quiet -o OUT/a.png", {"--figure": ["OUT/a.png", *INSTEAD]}),
    Row(rendered_labels, f"{SURFACE} --label 1 --opacity 1=0.5", {"--figure": ["OUT/a.png"]}),
    Row(rendered, f"figure {FIGURE} --threshold 100 --dpi 5", {"--dpi": ["40"]}),
    Row(rendered, f"{COLORED} --limit-mm 0", {"--limit-mm": ["2"]}),
    Row(rendered, f"{COLORED} {DECIMATE}", {"--simplifier": None}),
    Row(rendered, f"{SHEET} {DECIMATE}", {"--simplifier": None}),
    Row(rendered, f"{SHEET} --columns 3 --width-mm 36", {"--width-mm": ["99"], "--columns": ["1"]}),
    Row(rendered, f"{SHEET} --height-mm 20", {"--height-mm": ["54"]}),
    Row(
        rendered_labels,
        f"figure sheet {FIGURE} --label 1 --smoothing none --alphas 0 1",
        {"--threshold": ["0.5", "without --label"], "--smoothing": None},
    ),
    Row(rendered, f"{TURNTABLE}.mp4 --transparent", {"--transparent": None}),
    Row(earlier_video, f"{TURNTABLE}.mp4", {"--overwrite": []}),
    Row(earlier_frames, TURNTABLE, {"--resume": [], "--overwrite": []}),
    Row(earlier_frames, f"{TURNTABLE} --seconds 2 --resume", {"--overwrite": ["without --resume"]}),
    Row(rendered, f"{ALPHA} --threshold 100 {DECIMATE}", {"--simplifier": None}),
    Row(
        rendered_labels,
        f"{ALPHA} --overwrite",
        {
            "--threshold": ["0.5"],
            "--label": ["1", "--smoothing", "constrained"],
            "--smoothing": ["constrained", "--label", "1"],
        },
    ),
    Row(
        rendered_labels,
        f"{ALPHA} --overwrite --label 1",
        {"--threshold": ["0.5", "without --label"], "--smoothing": ["constrained"]},
    ),
    Row(earlier_experiment, f"{ALPHA} --threshold 100", {"--overwrite": []}),
    Row(mesh_file, f"{TURNING} --threshold 100", {"--threshold": None}),
]


def put_in(words, folder, path=""):
    """The words with their paths."""
    places = {"INPUT": str(path), "IN/": f"{folder / 'in'}/", "OUT": str(folder / "out")}
    for name, place in places.items():
        words = [word.replace(name, place) for word in words]
    return words


def row_name(row):
    return f"{row.make.__name__}, {row.words.partition(' ')[0]}"


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    """Pictures beside reconstructions are large, and how they look is not the matter."""
    if importlib.util.find_spec("bpy"):
        from ctmc_addon.blender.figure.rendering import render

        monkeypatch.setattr("ctmc_addon.blender.figure.rendering.samples.DENOISED", 1)
        monkeypatch.setattr(render, "render_figure_steps", partial(render.render_figure_steps, size=(280, 210)))


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
