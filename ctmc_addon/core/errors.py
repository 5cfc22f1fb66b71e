# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors that are not defects of this code, each with one sentence for the user.

A message names the value, the limit and the remedy. Callers turn a `CtmcError` into a message;
any other exception is a defect and stays a traceback.
"""


def one_line(text: str) -> str:
    r"""Replace non-printable characters by spaces, in text from files that a terminal shows.

    Examples
    --------
    >>> one_line("liver\n\x1b[31m")
    'liver  [31m'
    """
    return text if text.isprintable() else "".join(letter if letter.isprintable() else " " for letter in text)


class CtmcError(Exception):
    """The base of all errors that this project raises; its text is a sentence for the user, on one line."""

    def __init__(self, sentence: str = "") -> None:
        super().__init__(one_line(str(sentence)))


class SettingsError(CtmcError):
    """A setting outside its limits, or two settings that contradict each other."""


class VolumeError(CtmcError):
    """Values or an affine that cannot be a volume."""


class ReadError(CtmcError):
    """A file or folder that cannot be read as a CT."""


class DamagedSliceError(ReadError):
    """A slice that cannot be read to its end, in a series that can be read without it."""


class ThresholdError(CtmcError):
    """A threshold that no surface can have in this volume."""


class LabelError(CtmcError):
    """A label that the volume does not contain."""


class AbsentLabelError(LabelError):
    """A label that this volume does not have and another of its kind may have, as a patient may have no tumor."""


class MeshError(CtmcError):
    """A mesh that cannot be simplified or written as asked, or that came out empty."""


class MemoryLimitError(CtmcError):
    """Work that would need more memory than there is."""


class OutputError(CtmcError):
    """A file or folder that cannot be written."""
