# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplification of surfaces that come piece by piece."""
