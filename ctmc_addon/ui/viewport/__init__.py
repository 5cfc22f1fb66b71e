# SPDX-License-Identifier: GPL-3.0-or-later
"""What the 3D viewport shows and lets the mouse move."""
