# SPDX-License-Identifier: GPL-3.0-or-later
"""Read formats that hold a volume with its position in one file, or in a header and the files that it names."""
