# SPDX-License-Identifier: GPL-3.0-or-later
"""The properties of scene, object and preferences."""
