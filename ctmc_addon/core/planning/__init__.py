# SPDX-License-Identifier: GPL-3.0-or-later
"""What a work needs in bytes and seconds, what fits, and what to advise."""
