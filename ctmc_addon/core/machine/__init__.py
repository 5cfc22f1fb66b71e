# SPDX-License-Identifier: GPL-3.0-or-later
"""The processor's threads, the memory and the processes that work may use."""
