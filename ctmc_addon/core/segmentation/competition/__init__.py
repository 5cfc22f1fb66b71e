# SPDX-License-Identifier: GPL-3.0-or-later
"""Clicks that compete for the voxels around them."""
