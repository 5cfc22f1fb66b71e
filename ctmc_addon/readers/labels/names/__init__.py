# SPDX-License-Identifier: GPL-3.0-or-later
"""Names and colors of labels that stand in another place than the volume itself."""
