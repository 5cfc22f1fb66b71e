# SPDX-License-Identifier: GPL-3.0-or-later
"""Collapse the edges of a mesh in rounds."""
