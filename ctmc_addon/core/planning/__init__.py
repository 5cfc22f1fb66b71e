# SPDX-License-Identifier: GPL-3.0-or-later
"""Work out the bytes and seconds that a work needs, whether they fit, and the settings to advise."""
