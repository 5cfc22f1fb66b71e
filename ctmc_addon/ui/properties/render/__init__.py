# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the properties of renders and figures."""
