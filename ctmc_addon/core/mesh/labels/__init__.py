# SPDX-License-Identifier: GPL-3.0-or-later
"""The surfaces of labels that touch, as one complex of triangles."""
