# SPDX-License-Identifier: GPL-3.0-or-later
"""Connect to the scheduler of a dask.distributed cluster."""

from __future__ import annotations

import importlib
import logging
import re
import time
from pathlib import Path
from typing import Any

from ...core import CtmcError

PACKAGE = Path(__file__).resolve().parents[2]
PATIENCE = 10.0  # Seconds within which a scheduler has to answer.


class Scheduler:
    """A connection to a scheduler; raises `CtmcError` if none can be made."""

    def __init__(self, address: str) -> None:
        self.address = address
        if __name__.partition(".")[0] != PACKAGE.name:
            raise CtmcError(
                "--scheduler needs the Python package ctmc-addon, here and on the workers; the "
                "Blender extension does not use the network"
            )
        if not re.fullmatch(r"((tcp|tls|ucx|ws|wss)://)?\S+:\d+/?", address):
            raise CtmcError(f"'{address}' is not a scheduler's address; write one such as tcp://host:8786")
        try:
            self.distributed: Any = importlib.import_module("distributed")
        except ImportError as error:
            raise CtmcError(
                f"--scheduler needs dask.distributed ({error}); pip install 'ctmc-addon[cluster]'"
            ) from error
        for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # our error says it in a sentence
        import asyncio  # here, as every command imports this module

        start = time.perf_counter()
        try:
            asyncio.run(asyncio.wait_for(self.greet(), PATIENCE))
            self.client: Any = self.distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except MemoryError as error:  # letters of another protocol, taken for a length
            raise CtmcError(
                f"the program at {address} is not a dask scheduler; check the port, by default 8786 "
                "(8787 is its web page)"
            ) from error
        except (OSError, ValueError) as error:
            raise CtmcError(
                f"the scheduler {address} did not answer within {time.perf_counter() - start:.0f} s; "
                "check its address and that it is running"
            ) from error

    async def greet(self) -> None:
        """Exchange greetings once: a client would wait without end for one that takes calls and says nothing."""
        line = await self.distributed.comm.connect(self.address, timeout=PATIENCE)
        await line.close()

    def close(self) -> None:
        """End the connection; the cluster goes on."""
        self.client.close(timeout=PATIENCE)

    @property
    def workers(self) -> int:
        """Return the workers of the scheduler; raise `CtmcError` if it no longer answers."""
        try:
            return len(self.client.nthreads())
        except (OSError, TimeoutError) as error:
            raise CtmcError(f"the scheduler {self.address} stopped answering; run this again once it is up") from error
