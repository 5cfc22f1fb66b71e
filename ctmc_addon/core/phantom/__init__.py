# SPDX-License-Identifier: GPL-3.0-or-later
"""An abdominal CT with known truth, and a foam of any size."""

from .foam_slices import FOAM_THRESHOLD, foam
from .phantom import Phantom, phantom_steps
