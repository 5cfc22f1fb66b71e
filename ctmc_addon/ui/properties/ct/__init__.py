# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the properties of CTs and of their view."""
