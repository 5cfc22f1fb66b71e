# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands beside the surfaces: slices, volume, rulers."""
