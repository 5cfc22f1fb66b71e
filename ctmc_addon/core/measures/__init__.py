# SPDX-License-Identifier: GPL-3.0-or-later
"""Say what is known of a finished surface: its measures, their units, and the table of structures."""
