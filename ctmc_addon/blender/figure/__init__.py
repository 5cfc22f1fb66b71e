# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures for print: pages, sheets, distance maps and turntables of surfaces."""
