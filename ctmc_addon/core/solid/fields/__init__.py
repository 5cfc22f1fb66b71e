# SPDX-License-Identifier: GPL-3.0-or-later
"""Fields on a lattice of samples, and the shapes and distances that they are made from."""
