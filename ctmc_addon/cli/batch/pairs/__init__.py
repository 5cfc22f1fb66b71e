# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc batch --pairs`: compare the labels of many cases at two times."""
