# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the CTs of this session."""
