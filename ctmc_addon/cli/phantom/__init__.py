# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc phantom`: a CT with known truth as files of the usual formats."""
