# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistics of a volume's values, and the thresholds that follow from them."""
