# SPDX-License-Identifier: GPL-3.0-or-later
"""Headers that name data files elsewhere: read where the command line allows it, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.cli import main
from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume

VALUES = np.arange(4 * 5 * 6, dtype=np.int16).reshape(4, 5, 6)


@pytest.fixture(params=["../secret.raw", "absolute"])
def header(request, tmp_path):
    (tmp_path / "secret.raw").write_bytes(VALUES.tobytes())
    folder = tmp_path / "in"
    folder.mkdir()
    name = request.param if request.param != "absolute" else str(tmp_path / "secret.raw")
    text = "NRRD0004\ntype: short\ndimension: 3\nsizes: 6 5 4\nendian: little\nencoding: raw\n"
    (folder / "ct.nhdr").write_text(f"{text}data file: {name}\n\n")
    return folder / "ct.nhdr"


def test_the_command_line_may_allow_it(header, capsys, tmp_path):
    assert main(["info", str(header)]) == 1
    assert "--allow-outside" in capsys.readouterr().err
    assert main(["info", str(header), "--allow-outside"]) == 0
    assert "6 x 5 x 4" in capsys.readouterr().out
    out = tmp_path / "out"
    words = ["batch", str(header), "-o", str(out), "--threshold", "60", "--no-thumbnails"]
    assert main(words) == 1
    assert main([*words, "--resume", "--allow-outside"]) == 0
    with pytest.raises(ReadError, match="--allow-outside"):
        read_volume(header)
