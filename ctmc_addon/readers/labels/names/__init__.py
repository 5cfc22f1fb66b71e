# SPDX-License-Identifier: GPL-3.0-or-later
"""Read names and colors of labels that are stored outside the label values."""
