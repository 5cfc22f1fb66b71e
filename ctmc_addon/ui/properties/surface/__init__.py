# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the properties of the next surface."""
