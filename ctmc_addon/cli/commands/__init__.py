# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands that need one file: info, reconstruct, settings."""
