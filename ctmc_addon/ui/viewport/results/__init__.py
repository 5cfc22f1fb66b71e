# SPDX-License-Identifier: GPL-3.0-or-later
"""Show maps and rulers in the 3D viewport."""
