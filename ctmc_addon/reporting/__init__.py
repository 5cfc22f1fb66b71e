# SPDX-License-Identifier: GPL-3.0-or-later
"""Text and files that every front end writes."""
