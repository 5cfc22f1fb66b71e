# SPDX-License-Identifier: GPL-3.0-or-later
"""Read values from the bytes of a file, plain or packed."""
