# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known during a session and not stored in the file."""
