# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the volume of a label, and of each of its islands, in its smooth field."""
