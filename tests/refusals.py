# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that are refused in one sentence."""

import pytest

from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume


def refused(path, *words):
    """The sentence with which a path is refused; it names every one of `words`."""
    with pytest.raises(ReadError) as caught:
        read_volume(path)
    text = str(caught.value)
    assert all(str(word) in text for word in words), text
    assert "\n" not in text
    return text
