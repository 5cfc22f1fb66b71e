# SPDX-License-Identifier: GPL-3.0-or-later
"""A dask.distributed LocalCluster of two processes: prints its address, and kills a worker that is busy when told to.

A process of its own, run by the fixture `cluster`: the cluster's threads and warnings stay out of the tests'.
"""

import os
import signal
import sys
import time

from distributed import Client, LocalCluster


def main():
    options = {"n_workers": 2, "threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
    with LocalCluster(processes=True, silence_logs=50, **options) as cluster, Client(cluster) as client:
        processes = client.run(os.getpid)
        print(cluster.scheduler_address, flush=True)
        if not sys.stdin.readline().strip():
            return
        busy = []
        while not busy:
            time.sleep(0.05)
            busy = [worker for worker, tasks in client.processing().items() if tasks and worker in processes]
        os.kill(processes[busy[0]], signal.SIGTERM if os.name == "nt" else signal.SIGKILL)
        print("killed", flush=True)
        sys.stdin.readline()


if __name__ == "__main__":
    main()
