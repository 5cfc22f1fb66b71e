# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc batch`: a surface for each of many cases, several cases in a process."""
