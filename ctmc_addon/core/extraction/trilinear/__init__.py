# SPDX-License-Identifier: GPL-3.0-or-later
"""The topology of the trilinear interpolant: ambiguous cells and interior vertices."""
