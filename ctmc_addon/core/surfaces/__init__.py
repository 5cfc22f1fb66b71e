# SPDX-License-Identifier: GPL-3.0-or-later
"""The only way from a volume and settings to surfaces."""
