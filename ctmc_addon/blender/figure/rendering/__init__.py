# SPDX-License-Identifier: GPL-3.0-or-later
"""Render the pictures of a figure."""
