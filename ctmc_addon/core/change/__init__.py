# SPDX-License-Identifier: GPL-3.0-or-later
"""Change: the components of a label at two times, matched and compared."""
