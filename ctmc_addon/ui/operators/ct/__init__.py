# SPDX-License-Identifier: GPL-3.0-or-later
"""The CT: loading, viewing, its threshold, slice and region."""
