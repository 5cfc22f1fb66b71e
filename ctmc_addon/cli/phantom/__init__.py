# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc phantom`: write a CT with known truth as files of the usual formats."""
