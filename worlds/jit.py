"""How kernels are compiled: once per machine, kept on disk, free of the interpreter lock.

Without fast-math and without contraction, so that every CPU computes the same bits. Where the
package's folder is not writable, Numba keeps its cache in the user's (NUMBA_CACHE_DIR).
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Int = Any
Float = Any
"""Scalars of kernels: of Python or of NumPy, for Numba one thing and for mypy no one type."""

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Return the function compiled at its first call (arguments give the types)."""
    compiled_function: Function = numba.njit(nogil=True, cache=True, error_model="numpy")(function)
    return compiled_function
