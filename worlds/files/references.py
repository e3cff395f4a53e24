"""Loads user code by references `file.py:Name`, relative to the file that names it."""

import hashlib
import importlib.util
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from types import ModuleType

from worlds.files.documents import closest, closest_file
from worlds.files.paths import is_file, is_folder

_PREFIX = "wil_user_"
_LOADING = threading.RLock()
"""One file is loaded at a time: a module is in `sys.modules` before it is complete."""
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end this program or land vehicles: user files may not replace their handlers."""


class BadReferenceError(Exception):
    """A reference file.py:Name that cannot be resolved; why, and what was probably meant."""

    def __init__(self, message: str, suggestion: str = "") -> None:
        super().__init__(message)
        self.suggestion = suggestion


def is_reference(text: str) -> bool:
    """Return whether a text is a reference to a name in a file, not a shipped name."""
    return ".py" in text or ":" in text or "/" in text


def load_reference(text: str, folder: Path, *, beside: str = "the campaign") -> object:
    """Return what the reference `file.py:Name` names; the file is relative to a folder.

    beside: what messages call the file that has the reference.

    The file is run once in a process (see `forget_loaded`), and no bytecode is written; its output
    goes to stderr, because stdout may carry a document of this program. Raises
    BadReferenceError, with the line of the user's file that failed.
    """
    file, colon, name = text.rpartition(":")
    if not colon or not file.endswith(".py") or not name.isidentifier():
        raise BadReferenceError(f"'{text}' is not of the form file.py:Name")
    path = (folder / file).resolve()
    if not is_file(path):
        raise BadReferenceError(f"there is no file '{file}' beside {beside}", _sibling(path))
    with _LOADING:
        module = _load_module(path)
    found = getattr(module, name, None)
    if found is None:
        own = [key for key, value in vars(module).items() if _is_own(value, module)]
        raise BadReferenceError(f"there is no '{name}' in {file}", closest(name, own))
    return found


def forget_loaded() -> None:
    """Forget loaded user files, so that the next reference runs them anew."""
    for name in [name for name in sys.modules if name.startswith(_PREFIX)]:
        del sys.modules[name]


def _sibling(path: Path) -> str:
    """Return the Python file beside a misspelt reference that was probably meant."""
    if not is_folder(path.parent):
        return ""
    return closest_file(path.name, [other.name for other in path.parent.glob("*.py")])


def _is_own(value: object, module: ModuleType) -> bool:
    """Return whether a referenced value was defined in the user's own module."""
    return callable(value) and getattr(value, "__module__", None) == module.__name__


def _load_module(path: Path) -> ModuleType:
    """Return the module of a referenced file, run at most once."""
    name = f"{_PREFIX}{path.stem}_{hashlib.sha256(bytes(path)).hexdigest()[:12]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BadReferenceError(f"'{path.name}' cannot be loaded as Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    wrote, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        with _restored_signals(), redirect_stdout(sys.stderr):
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise BadReferenceError(
            f"'{path.name}' cannot be loaded: {_error_text(error, path)}"
        ) from error
    finally:
        sys.dont_write_bytecode = wrote
    return module


@contextmanager
def _restored_signals() -> Iterator[None]:
    """Restore this process's handlers of ending signals after user code has run."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None and signal.getsignal(number) is not handler:
                signal.signal(number, handler)


def _error_text(error: BaseException, path: Path) -> str:
    """Return an import error of a referenced file with the user's line that led to it."""
    text = f"{type(error).__name__}: {error}"
    if isinstance(error, SyntaxError):
        return text
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame.lineno for frame in frames if Path(frame.filename) == path]
    return f"line {own[-1]}: {text}" if own else text
