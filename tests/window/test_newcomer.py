# SPDX-License-Identifier: GPL-3.0-or-later
"""The newcomer's way of docs/sidebar.md takes at most 10 clicks and 10 notches of the wheel up to a render."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from window import newcomer
from window.conftest import CT
from window.desk import Desk

pytestmark = [pytest.mark.window, pytest.mark.once]

RENDER = (160, 120)  # pixels, to be fast
LIMIT = 600.0  # seconds of a render without a graphics card


def test_from_the_zip_to_a_render_in_ten_clicks(opened: Callable[[], Desk], package: Path, phantom: Path):
    desk = Desk(opened().root, opened().pictures / "newcomer", newcomer.SIZE, LIMIT)
    try:
        desk.install(package)
        desk.bring(phantom / CT)
        desk.open()
        person = newcomer.go(desk, f"{desk.inside}/{CT}", 0.0, lambda *_: None, RENDER)
        assert person.clicks <= 10
        assert person.notches <= 10
        assert "Traceback" not in desk.printed()
    finally:
        desk.close()
