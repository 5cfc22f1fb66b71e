# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the structures of a CT, and what surfaces of them would be."""
