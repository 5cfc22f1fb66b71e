# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats that hold a volume with its place in one file, or in a header and what it names."""
