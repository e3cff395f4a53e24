"""Loads user code by references `file.py:Name`, relative to the file that names it."""

import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from types import ModuleType

from wil_campaign.foundation.files.documents import closest_file, closest_word
from wil_campaign.foundation.files.paths import is_file, is_folder
from wil_campaign.foundation.files.user_modules import (
    user_file_path,
    user_folder,
    with_user_module_names,
)

_OURS = "wil_campaign"
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

    The file is run once in a process (see `forget_user_modules`), and no bytecode is written; its
    output goes to stderr, because stdout may carry a document of this program. It imports what
    stands beside it. Raises BadReferenceError, with the line of the user's file that failed.
    """
    file, colon, name = text.rpartition(":")
    if not colon or not file.endswith(".py") or not name.isidentifier():
        raise BadReferenceError(f"'{text}' is not of the form file.py:Name")
    path = (folder / file).resolve()
    if not is_file(path):
        raise BadReferenceError(_missing_text(path, file, beside), _sibling(path))
    _require_free_name(path)
    with _LOADING:
        module = _load_module(path)
    found = getattr(module, name, None)
    if found is None:
        own = [key for key, value in vars(module).items() if _is_own(value, module)]
        raise BadReferenceError(f"there is no '{name}' in {file}", closest_word(name, own))
    return found


def _missing_text(path: Path, file: str, beside: str) -> str:
    """Return why a referenced file is not there: the system's reason where it has one."""
    try:
        path.stat()
    except FileNotFoundError:
        return f"there is no file '{file}' beside {beside}"
    except OSError as error:
        return f"'{file}' beside {beside} cannot be read: {error.strerror}"
    return f"'{file}' beside {beside} is no file"


def _require_free_name(path: Path) -> None:
    """Raise BadReferenceError where a user's module has the name of this program.

    Of the two, the user's files could import only one.
    """
    for taken in (path.parent / f"{_OURS}.py", path.parent / _OURS / "__init__.py"):
        if is_file(taken) and user_file_path(str(taken)) is not None:
            raise BadReferenceError(
                f"'{taken.relative_to(path.parent)}' beside '{path.name}' has the name of this "
                "program, which your files import: rename it"
            )


def _sibling(path: Path) -> str:
    """Return the Python file beside a misspelt reference that was probably meant."""
    if not is_folder(path.parent):
        return ""
    return closest_file(path.name, [other.name for other in path.parent.glob("*.py")])


def _is_own(value: object, module: ModuleType) -> bool:
    return callable(value) and getattr(value, "__module__", None) == module.__name__


def _load_module(path: Path) -> ModuleType:
    """Return the module of a referenced file, run at most once."""
    wrote, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        with _restored_signals(), redirect_stdout(sys.stderr):
            return user_folder(path.parent).load(path.stem)
    except (Exception, SystemExit) as error:
        raise BadReferenceError(
            f"'{path.name}' cannot be loaded: {_error_text(error, path)}"
        ) from error
    finally:
        sys.dont_write_bytecode = wrote


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
    """Return an import error of a referenced file with the user's line that led to it.

    The line is of the file itself, or of the one beside it that failed.
    """
    text = with_user_module_names(f"{type(error).__name__}: {error}")
    if isinstance(error, SyntaxError):
        return text
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if Path(frame.filename).is_relative_to(path.parent)]
    if not own:
        return text
    place = Path(own[-1].filename)
    file = "" if place == path else f"{place.relative_to(path.parent)}, "
    return f"{file}line {own[-1].lineno}: {text}"
