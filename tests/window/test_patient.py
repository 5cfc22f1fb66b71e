# SPDX-License-Identifier: GPL-3.0-or-later
"""A patient's folder with several series, by mouse: told apart on the screen, and their words nowhere else."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from PIL import ImageChops
from window.scenes import IDLE, QUIET, begin, load

pytestmark = [pytest.mark.window, pytest.mark.once]

NO_OBJECTS = "bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes, *bpy.data.materials])"
ABOVE = "bpy.ops.ctmc.remove_table()"  # the button above the dropdown of series
ROW = 26  # pixels from one row of the sidebar, or of a menu, to the next
FACTS_HEIGHT = 120  # pixels, of the dropdown and the lines below it


def write_series(folder, number, **tags):
    """A DICOM series of three slices in a folder of its own, `tags` as the scanner's operator set them."""
    from pydicom import dcmwrite, uid
    from pydicom.dataset import Dataset, FileMetaDataset

    (folder / str(number)).mkdir(parents=True)
    for at in range(3):
        dataset = Dataset()
        dataset.file_meta = FileMetaDataset()
        dataset.file_meta.TransferSyntaxUID = uid.ExplicitVRLittleEndian
        dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = uid.CTImageStorage
        name = f"1.2.9.{number}.{at}"
        dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID = name
        dataset.PatientName, dataset.PatientID, dataset.StudyInstanceUID = "Muster^Erika", "4711", "1.2.9"
        dataset.SeriesInstanceUID, dataset.Modality = f"1.2.9.{number}", "CT"
        dataset.Rows = dataset.Columns = 16
        dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
        dataset.BitsAllocated = dataset.BitsStored = 16
        dataset.HighBit, dataset.PixelRepresentation = 15, 1
        dataset.RescaleSlope, dataset.RescaleIntercept, dataset.InstanceNumber = 1, 0, at + 1
        dataset.PixelSpacing, dataset.ImageOrientationPatient = [1, 1], [1, 0, 0, 0, 1, 0]
        gap = tags.pop("gap", 2)
        dataset.ImagePositionPatient = [0, 0, at * gap]
        for word, value in {"SeriesNumber": number, **tags}.items():
            setattr(dataset, word, value)
        tags["gap"] = gap
        values = np.full((16, 16), -1000, np.int16)
        values[4:12, 4:12] = 100 * number + np.arange(8)  # two values alone would be a mask
        dataset.PixelData = values.tobytes()
        dataset["PixelData"].VR = "OW"
        dcmwrite(folder / str(number) / f"{at}.dcm", dataset, enforce_file_format=True)


def series_facts(desk, name, **tags):
    """A picture of what the sidebar says of the second of two series, which has these tags."""
    folder = desk.folder / "study"
    if folder.exists():
        shutil.rmtree(folder)
    write_series(folder, 1, SeriesDescription="AAA", ConvolutionKernel="B10f")
    write_series(folder, 2, **{"SeriesDescription": "AAA", "ConvolutionKernel": "B10f", **tags})
    desk.ask(NO_OBJECTS)
    load(desk, f"{desk.inside}/study", series="2")
    left, width = desk.ask("bar = viewport().sidebar; answer = [bar.x, bar.width]")
    _, y = desk.find(ABOVE)
    desk.move(left - 200, y)
    picture = desk.look(f"patient-01-{name}")
    return picture.crop((left, y + ROW // 2, left + width - 30, y + FACTS_HEIGHT))


@pytest.fixture(scope="module", autouse=True)
def tab(desk):
    """The tab is open on an empty scene."""
    begin(desk)


def test_series_are_told_apart_by_what_the_scanner_says_and_their_words_stay_on_the_screen(desk):
    plain = series_facts(desk, "plain")
    for name, tags in {
        "number": {"SeriesNumber": 8},
        "description": {"SeriesDescription": "MUSTER"},
        "kernel": {"ConvolutionKernel": "B70f"},
        "spacing": {"gap": 5},
    }.items():
        other = series_facts(desk, name, **tags)
        assert ImageChops.difference(plain, other).getbbox() is not None, f"{name} is not shown"
    series_facts(desk, "words", SeriesDescription="MUSTER")
    x, y = desk.find(ABOVE)
    desk.click(x, y + ROW)
    desk.look("patient-02-dropdown")
    desk.click(x, y + 2 * ROW)
    desk.look("patient-02-chosen")
    desk.wait(f"{IDLE} and ours('ui.state.ct.volumes').loaded(bpy.context.scene).series_number == 1")
    desk.wait(QUIET)
    desk.look("patient-03-first")
    written = desk.ask("""
loaded = ours("ui.state.ct.volumes").loaded(bpy.context.scene)
blocks = [block.name for kind in (bpy.data.objects, bpy.data.collections, bpy.data.meshes) for block in kind]
answer = [loaded.volume.name, *loaded.volume.notes, *blocks]
""")
    assert "MUSTER" not in " ".join([*written, desk.last_words()]).upper()


def test_the_console_is_silent(desk):
    log = desk.printed()
    for word in ("Traceback", "Error:", "rna_uiItem", "GPUBatch", "Muster"):
        assert word not in log, log[-3000:]
