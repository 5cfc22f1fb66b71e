# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplification of the surfaces of several labels that touch, all at once."""
