# SPDX-License-Identifier: GPL-3.0-or-later
"""Decode compressed pixels in a separate process, which a damaged or hostile file may crash without harm."""
