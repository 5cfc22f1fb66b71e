# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc experiment`: the experiments of Su and Ma on any CT."""
