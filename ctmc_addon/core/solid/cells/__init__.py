# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts from several fields at once: cells cut along straight rims."""
