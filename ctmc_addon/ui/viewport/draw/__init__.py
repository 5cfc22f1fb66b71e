# SPDX-License-Identifier: GPL-3.0-or-later
"""Show drawings and their tools in the 3D viewport."""
