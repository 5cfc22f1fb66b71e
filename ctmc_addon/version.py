# SPDX-License-Identifier: GPL-3.0-or-later
"""The version, in the one place from which the package, the reports and the build take it."""

VERSION = "0.3.0"
