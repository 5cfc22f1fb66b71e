# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the tests of core and readers as on a plain processor: without the fast versions that NumPy and others choose.

NumPy, its linear algebra and the system's mathematics choose versions of an operation by the processor as they start.
They may differ in the last bit, so what decides a voxel, a tie or an order must not come from them. Here each takes the
version that needs least. What it chooses elsewhere is told from the processor, so `make test` covers the other end.
`make test-all` runs core so with the oldest NumPy.
"""

from __future__ import annotations

import os
import subprocess
import sys

from run_tests import REPEATED, run_tests

PLACES = ["tests/core", "tests/reporting", "tests/readers"]
# NumPy warns of features that it has no version for, and of those that the processor lacks.
CHOSEN_FEATURES = """
try:
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
except ImportError:  # NumPy 1
    from numpy.core._multiarray_umath import __cpu_dispatch__, __cpu_features__
print(*(name for name in __cpu_dispatch__ if __cpu_features__[name]))
"""


def plain_environment(python: str) -> dict[str, str]:
    """Return the variables of the environment under which a Python's NumPy runs as on a plain processor.

    Parameters
    ----------
    python : str
        The interpreter, with NumPy.
    """
    environment = {name: value for name, value in os.environ.items() if name != "NPY_DISABLE_CPU_FEATURES"}
    features = subprocess.run(
        [python, "-c", CHOSEN_FEATURES], env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()
    return {
        "NPY_DISABLE_CPU_FEATURES": features,
        "OPENBLAS_CORETYPE": "Prescott",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4",
    }


def main() -> int:
    """Run the tests, with pytest's arguments for more; returns pytest's status."""
    plain = plain_environment(sys.executable)
    return run_tests(sys.executable, [*REPEATED, *(sys.argv[1:] or PLACES)], variables=plain)


if __name__ == "__main__":
    sys.exit(main())
