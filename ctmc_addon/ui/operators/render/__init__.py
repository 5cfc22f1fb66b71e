# SPDX-License-Identifier: GPL-3.0-or-later
"""Render: camera and lights, figures, the rotation test, and the CT as an object."""
