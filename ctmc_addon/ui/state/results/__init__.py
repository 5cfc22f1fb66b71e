# SPDX-License-Identifier: GPL-3.0-or-later
"""Find surfaces, and keep what is known of them."""
