# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the flags of commands, and collect their values."""
