# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep state of a session that is not stored in the file."""
