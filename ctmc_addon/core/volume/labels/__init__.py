# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels of a volume: which there are, how large, how named and colored."""
