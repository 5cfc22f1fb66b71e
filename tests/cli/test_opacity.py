# SPDX-License-Identifier: GPL-3.0-or-later
"""`--opacity NAME=SHARE`, from the command line into a file."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

nibabel = pytest.importorskip("nibabel")

from ctmc_addon.cli import main


@pytest.fixture
def labels(tmp_path):
    values = np.zeros((12, 8, 8), np.uint8)
    values[2:5, 2:6, 2:6], values[7:10, 2:6, 2:6] = 1, 2
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / "labels.nii.gz")
    return tmp_path / "labels.nii.gz"


def shares(path):
    raw = path.read_bytes()
    tree = json.loads(raw[20 : 20 + struct.unpack_from("<I", raw, 12)[0]])
    return [material["pbrMetallicRoughness"]["baseColorFactor"][3] for material in tree["materials"]]


def test_shares_reach_a_glb_by_number(labels, tmp_path):
    path = tmp_path / "both.glb"
    command = [
        "reconstruct",
        str(labels),
        "-o",
        str(path),
        "--label",
        "all",
        "--quiet",
        "--opacity",
        "1=0.35",
        "2=0.15",
    ]
    assert main(command) == 0
    assert shares(path) == pytest.approx([0.35, 0.15])


@pytest.mark.parametrize(
    ("output", "opacity", "said"),
    [
        ("a.stl", "1=0.5", "STL and PLY files hold no opacity"),
        ("a.glb", "1=1.5", "from 0 to 1"),
        ("a.glb", "spleen=0.5", "--opacity names 'spleen', but no structure has that name"),
    ],
)
def test_what_cannot_be_is_refused(labels, tmp_path, capsys, output, opacity, said):
    command = ["reconstruct", str(labels), "-o", str(tmp_path / output), "--label", "1", "--opacity", opacity]
    try:
        code = main(command)
    except SystemExit as end:
        code = end.code
    assert code != 0
    assert said in capsys.readouterr().err
