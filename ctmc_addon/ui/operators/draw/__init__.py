# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw structures on the CT: strokes and clicks of the tools, and edits of a whole structure."""
