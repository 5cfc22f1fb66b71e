# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the commands that need one file, such as info, reconstruct and settings."""
