# SPDX-License-Identifier: GPL-3.0-or-later
"""Workers in this process, to whom tasks are sent as if they were other machines."""

import pickle

from volumes import in_file

from ctmc_addon.core import finish
from ctmc_addon.core.extraction.field_pieces import slab_result_steps


class OtherWorkers:
    """Workers with a volume of their own, to whom tasks are sent and who send results."""

    def __init__(self, volume, count):
        self.volume, self.count, self.layers, self.closed = volume, count, [], 0

    def results(self, tasks):
        try:
            for task in tasks:
                self.layers.append(task.layers)
                yield None
                steps = slab_result_steps(in_file(self.volume), pickle.loads(pickle.dumps(task)))
                yield pickle.loads(pickle.dumps(finish(steps)))
        finally:
            self.closed += 1
