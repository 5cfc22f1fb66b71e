# SPDX-License-Identifier: GPL-3.0-or-later
"""Compose the page of a figure: pictures, legends, axes, captions."""
