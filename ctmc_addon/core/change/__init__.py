# SPDX-License-Identifier: GPL-3.0-or-later
"""Match and compare the components of a label at two times."""
