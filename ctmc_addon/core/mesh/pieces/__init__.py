# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface as pieces: kept once, completed at their seams, without small components."""
