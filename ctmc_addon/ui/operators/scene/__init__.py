# SPDX-License-Identifier: GPL-3.0-or-later
"""Add and change objects other than surfaces: slices, volume, rulers."""
