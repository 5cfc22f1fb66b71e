# SPDX-License-Identifier: GPL-3.0-or-later
"""Show in the 3D viewport what Reconstruct would make, and follow its settings."""
