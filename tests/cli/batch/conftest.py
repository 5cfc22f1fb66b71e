# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
from batches import FLAGS, ball

from ctmc_addon.cli import main


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("Fälle 病例")
    for name, radius in (("large", 7), ("small", 4)):
        np.save(folder / f"{name}.npy", ball(radius))
    (folder / "broken.npy").write_bytes((folder / "large.npy").read_bytes()[:4000])
    return folder


@pytest.fixture(scope="module")
def done(scene, cases, tmp_path_factory):
    """A batch of three cases, one of them broken; the output's parents are not there."""
    folder = tmp_path_factory.mktemp("out") / "a" / "b"
    assert main(["batch", str(cases), "-o", str(folder), *FLAGS, "--simplify", "0.5"]) == 1
    return folder
