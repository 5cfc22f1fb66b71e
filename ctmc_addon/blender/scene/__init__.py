# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects and settings of a scene that belong to no surface: lights, cameras, the timeline, the CT's box."""
