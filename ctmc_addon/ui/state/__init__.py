# SPDX-License-Identifier: GPL-3.0-or-later
"""State of a session that is not stored in the file."""
