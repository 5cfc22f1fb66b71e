# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep a simplified surface within a maximum error, and free of crossings."""
