# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing structures on the CT: the tools' strokes and clicks, and what is done to a structure as a whole."""
