# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors that the project raises on purpose."""

from ctmc_addon.core import CtmcError, errors


def test_every_error_is_the_projects_own():
    classes = [error for name, error in vars(errors).items() if name.endswith("Error")]
    assert len(classes) > 5
    assert all(issubclass(error, CtmcError) for error in classes)
