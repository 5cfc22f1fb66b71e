# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that are written: whole or not at all, and surfaces as STL and PLY."""
