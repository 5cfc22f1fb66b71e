# SPDX-License-Identifier: GPL-3.0-or-later
"""Make, export and read back surfaces in the Blender file.

Every function takes the object or the scene it works on; none reads the context. Nothing is imported here:
`figure.spec` and `colors` know no Blender, so whoever only asks for names and limits needs none.
"""
