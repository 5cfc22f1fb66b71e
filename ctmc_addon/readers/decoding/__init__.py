# SPDX-License-Identifier: GPL-3.0-or-later
"""Compressed pixels decoded in a process of its own, which a damaged or hostile file may end without harm."""
