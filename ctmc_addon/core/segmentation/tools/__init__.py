# SPDX-License-Identifier: GPL-3.0-or-later
"""Make and edit masks: a module for each tool."""
