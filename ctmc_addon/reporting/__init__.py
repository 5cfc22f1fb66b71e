# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the texts that all front ends share."""
