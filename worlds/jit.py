"""JIT compilation of kernels by Numba: once per machine, cached on disk, without the GIL.

Without fast-math and without contraction, so that every CPU computes the same bits.

Numba caches a kernel until its own file changes, and ignores changes of files whose kernels it
calls; so the cache is in a folder named after a digest of the sources that it may call: the shared
kernels' (`_KERNEL_FILES`), and all files beside the kernel's own. The folder is in NUMBA_CACHE_DIR,
else beside the package, else in the user's cache, else beneath TMPDIR: the first that is writable
and that no other user can change, because what is loaded from it is run. Without one each process
compiles its kernels.
"""

import hashlib
import os
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from wil_campaign.foundation.files.own_folders import fault_of_folder, home_folder

F64 = NDArray[np.float64]
Int = Any
Float = Any
"""Scalars of kernels: Python's or NumPy's, which Numba treats alike and mypy does not."""

Function = TypeVar("Function", bound=Callable[..., object])

_HERE = Path(__file__).parent
_KERNEL_FILES = (
    "worlds/jit.py",
    "worlds/clearance/gjk.py",
    "worlds/clearance/surfaces.py",
    "vehicles/embedded/control/kernels.py",
    "vehicles/embedded/physics/motion_kernel.py",
)
"""Sources of kernels that kernels of other packages call."""


def sources_digest(files: list[Path]) -> str:
    """Return a digest of source files, the key of the cache of JIT-compiled kernels."""
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(f"{file.name}\0".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class KernelCache:
    """Where a package's JIT-compiled kernels are cached; folder: None when there is no safe place.

    passed_over: what is wrong with the places before it, in words.
    """

    folder: Path | None
    passed_over: tuple[str, ...]


@cache
def find_kernel_cache(package: Path = _HERE / "render") -> KernelCache:
    """Return the cache of a package's JIT-compiled kernels; its folder is made."""
    sources = {*(_HERE.parent / file for file in _KERNEL_FILES), *_HERE.glob("render/*.py")}
    name = "kernels-" + sources_digest(sorted(sources | set(package.glob("*.py"))))
    passed_over: list[str] = []
    for folder in _places(name):
        fault = _make_private(folder)
        if not fault:
            return KernelCache(folder, tuple(passed_over))
        passed_over.append(f"{folder} {fault}")
    return KernelCache(None, tuple(passed_over))


def cache_folder(package: Path) -> Path | None:
    """Return the cache folder of a package's JIT-compiled kernels; None without a safe one."""
    return find_kernel_cache(package).folder


def _places(name: str) -> Iterator[Path]:
    """Yield the folders for a cache of this name, the first choice first."""
    if requested := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(requested) / name
    else:
        yield _HERE / "__pycache__" / name
        if cache_home := os.environ.get("XDG_CACHE_HOME"):
            yield Path(cache_home) / "wil-campaign" / name
        elif (home := home_folder()) is not None:
            yield home / ".cache" / "wil-campaign" / name
    with suppress(OSError):  # there is no folder for temporary files
        yield Path(tempfile.gettempdir()) / f"wil-{os.getuid()}-{name}"


def _make_private(folder: Path) -> str:
    """Make a folder that no other user can change; return why it is of no use, or ""."""
    try:
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        return f"cannot be made: {error.strerror or error}"
    if fault := fault_of_folder(folder, denied=0o022):
        return fault
    return "" if os.access(folder, os.W_OK | os.X_OK) else "is not writable"


def jit_compiled(function: Function) -> Function:
    """Return the function JIT-compiled at its first call (arguments give the types)."""
    return cast("Function", _Kernel(function, is_cached=True))


def is_kernel_cached(kernel: Callable[..., object]) -> bool:
    """Return whether a JIT-compiled kernel is on disk already: its first call loads it."""
    folder = cache_folder(Path(kernel.__code__.co_filename).parent)
    return folder is not None and any(folder.rglob(f"*.{kernel.__name__}-*.nbi"))


def kernel_dispatcher(kernel: Function) -> Function:
    """Return Numba's dispatcher of a kernel, for callers that call it hundreds of times a second.

    It saves a Python call each time; Numba is imported now.
    """
    return cast("Function", cast("Any", kernel).dispatcher)


def python_function(kernel: Function) -> Function:
    """Return a kernel's function in Python, for a few numbers: to import Numba takes longer."""
    return cast("Function", cast("_Kernel", kernel).function)


def jit_inlined(function: Function) -> Function:
    """Return a helper that is JIT-compiled into each kernel that calls it.

    It is not cached by itself. Each saves about 0.2 s of the first compilation.
    """
    return cast("Function", _Kernel(function, is_cached=False, inline="always"))


@cache
def _numba() -> Any:
    """Return Numba, imported without its trial import of SciPy's linear algebra.

    Numba's import takes a third of a second, which few commands need; the trial took another fifth
    in each process that calls a kernel, to learn that SciPy is there. A kernel with a product of
    matrices still imports it when it is compiled.
    """
    import numba  # noqa: PLC0415, TID251 - see above
    from numba.np import linalg  # noqa: PLC0415, TID251

    tried = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = tried
    return numba


class _Kernel:
    """A function for which Numba is imported at its first call, which takes half a second.

    For Numba it stands in for its dispatcher, whose attributes another kernel reads to call it.
    """

    _loading = threading.RLock()
    """Guards Numba's cache folder, which is a setting of the whole process."""

    def __init__(self, function: Callable[..., object], *, is_cached: bool, **options: str) -> None:
        self.function = function
        self._is_cached = is_cached
        self._options = options
        self.__name__ = function.__name__
        self.__doc__ = function.__doc__
        self.__code__ = function.__code__

    def __call__(self, *arguments: object) -> object:
        return self.dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.dispatcher, name)

    @cached_property
    def dispatcher(self) -> Any:
        with self._loading:
            numba = _numba()
            folder = (
                cache_folder(Path(self.__code__.co_filename).parent) if self._is_cached else None
            )
            before = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = str(folder or "")
            try:
                return numba.njit(
                    nogil=True, cache=folder is not None, error_model="numpy", **self._options
                )(self.function)
            finally:
                numba.config.CACHE_DIR = before
