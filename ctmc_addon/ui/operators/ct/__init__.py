# SPDX-License-Identifier: GPL-3.0-or-later
"""Load and view the CT; set its threshold, slice and region."""
