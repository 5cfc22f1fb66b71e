# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the table of a batch: a row for each output, as CSV, JSON and a page, with outliers marked."""

from .rows import SummaryRow, amount, counts
from .write import LABELS_FILE, SUMMARY_FILES, write_summary, write_summary_if_possible
