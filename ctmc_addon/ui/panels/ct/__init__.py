# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the panels of the CT: volume, slice, region."""
