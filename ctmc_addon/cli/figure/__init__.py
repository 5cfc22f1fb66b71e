# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `ctmc figure`: figures, sheets and turntables from one command."""
