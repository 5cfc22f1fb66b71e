# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the properties of scene, object and preferences."""
