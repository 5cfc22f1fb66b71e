# SPDX-License-Identifier: GPL-3.0-or-later
"""Extract parts from several fields at once, with straight rims where their surfaces meet."""
