# SPDX-License-Identifier: GPL-3.0-or-later
"""Adapt a command to its machine: memory, signals, Blender and a cluster's scheduler."""
