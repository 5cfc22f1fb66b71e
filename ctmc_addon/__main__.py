# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m ctmc_addon ...` is `ctmc ...`."""

import sys

from .cli import main

sys.exit(main())
