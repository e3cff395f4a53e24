"""What a process pays for its first kernel."""

import subprocess
import sys

_FIRST_KERNEL = """
import sys
import numpy as np
from worlds.jit import inlined

@inlined
def doubled(value):
    return 2.0 * value

assert doubled(1.5) == 3.0
assert "scipy.linalg" not in sys.modules

import numba

assert np.array_equal(numba.njit(lambda a, b: a @ b)(np.eye(2), np.eye(2)), np.eye(2))
"""


def test_the_first_kernel_imports_no_linear_algebra_and_others_still_have_it() -> None:
    subprocess.run(  # noqa: S603 - our own words
        [sys.executable, "-c", _FIRST_KERNEL], check=True, timeout=120.0
    )
