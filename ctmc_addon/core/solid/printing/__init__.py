# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the facts about parts that a print lab needs."""
