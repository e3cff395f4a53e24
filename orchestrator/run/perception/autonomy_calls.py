"""Asking the autonomy under test: whatever it answers, a command or its fault comes of it."""

import math
import signal
import sysconfig
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Literal, NoReturn, TypeVar

from campaigns.values.autonomy_limits import LONGEST_CALL_S
from vehicles.autonomy import Command
from vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from worlds.files.problems import printable
from worlds.frames import Vec3

T = TypeVar("T")

_MEMORY_REMEDY = "ask for less, or raise autonomy.limits.memory_mb"
_AGAIN_S = 1.0
_LONGEST_TEXT = 300
_LONGEST_NOTE = 80
_LONGEST_LINE = 100
_LONGEST_TRACE = 8000
_STANDARD_LIBRARY = Path(sysconfig.get_path("stdlib"))
_ROOT = Path(__file__).parents[3]
_OURS = tuple(
    _ROOT / name
    for name in ("campaigns", "orchestrator", "recipes", "safety", "vehicles", "worlds")
)
"""Our packages, a library to the autonomy also where they are run from their sources."""
_SHIPPED = _ROOT / "campaigns" / "autonomies"
"""The autonomies among them are under test as a user's are."""
_LARGEST = 1e6
"""Metres and metres per second; also, what MAVLink's 32 bits of a float hold many times over."""


class AutonomyFault(Exception):  # noqa: N818 - it is what is under test that failed
    """The autonomy under test failed in a call; says how, and where in its code.

    trace: the whole traceback of what it raised; empty where it raised nothing. kind: what the run
    comes to by it; ERROR where the machine's memory ends it, which is no statement about it.
    """

    def __init__(
        self, message: str, trace: str = "", kind: Literal["FAIL", "ERROR"] = "FAIL"
    ) -> None:
        super().__init__(message)
        self.trace = trace
        self.kind: Literal["FAIL", "ERROR"] = kind


class _HangWarning(BaseException):
    """Raised in the autonomy's code when a call hangs; no `except Exception` catches it."""


def call_autonomy(
    ask: Callable[[], T], *, within_s: float = LONGEST_CALL_S, limit: str = "call_s"
) -> T:
    """Return the result of a call of the autonomy. Raises AutonomyFault, and nothing else.

    limit: which of the autonomy's limits within_s is. SystemExit, KeyboardInterrupt and
    CancelledError are faults, too: nothing but the autonomy's own code raises them in a call that
    does not await.
    """
    try:
        with _alarm(within_s):
            return ask()
    except _HangWarning as error:
        name = f"autonomy.limits.{limit}"
        said = f"gave no answer within {within_s:g} s, its limit ({name}) ({_place_of(error)})"
        raise AutonomyFault(said, _trace(error)) from None
    except BaseException as error:  # noqa: BLE001 - whatever the code under test raises
        said = f"{_error_text(error)} ({_place_of(error)})"
        # Of a file of the user's that runs out of memory while it is imported it is the cause.
        if isinstance(error, MemoryError) or isinstance(error.__cause__, MemoryError):
            said = f"was refused memory: {said}; {_MEMORY_REMEDY}"
            raise AutonomyFault(said, _trace(error), "ERROR") from None
        raise AutonomyFault(f"crashed: {said}", _trace(error)) from None


def command_of(answer: object) -> Command:
    """Return the command that the autonomy's `act` returned, checked. Raises AutonomyFault."""
    if not isinstance(answer, Command):
        raise AutonomyFault(f"returned {_kind(answer)}, not a Command")
    note = answer.note
    if not isinstance(note, str):
        raise AutonomyFault(f"returned a note that is {_kind(note)}, not text")
    return Command(_setpoint(answer.setpoint), bool(answer.done), printable(note)[:_LONGEST_NOTE])


def _setpoint(given: object) -> Setpoint:
    """Return the autonomy's setpoint, checked. Raises AutonomyFault."""
    match given:
        case VelocitySetpoint(velocity, yaw_rad, yaw_rate_rad_s):
            if yaw_rad is not None and yaw_rate_rad_s is not None:
                raise AutonomyFault("returned a setpoint with both yaw_rad and yaw_rate_rad_s")
            return VelocitySetpoint(
                _vector("velocity_ned_m_s", velocity),
                _optional("yaw_rad", yaw_rad),
                _optional("yaw_rate_rad_s", yaw_rate_rad_s),
            )
        case PositionSetpoint(position, yaw_rad):
            return PositionSetpoint(
                _vector("position_ned_m", position), _optional("yaw_rad", yaw_rad)
            )
    raise AutonomyFault(f"returned a Command whose setpoint is {_kind(given)}")


def _vector(name: str, given: Sequence[object]) -> Vec3:
    """Return a vector of the autonomy's setpoint, checked. Raises AutonomyFault."""
    try:
        north, east, down = given
    except (TypeError, ValueError):
        raise AutonomyFault(f"returned a setpoint whose {name} is not three numbers") from None
    return (_number(name, north), _number(name, east), _number(name, down))


def _optional(name: str, given: object) -> float | None:
    """Return an optional number of the autonomy's setpoint; None for None."""
    return None if given is None else _number(name, given)


def _number(name: str, given: object) -> float:
    """Return a number of the autonomy's setpoint. Raises AutonomyFault."""
    if isinstance(given, str):
        raise AutonomyFault(f"returned a setpoint whose {name} contains {_kind(given)}")
    try:
        number = float(given)  # type: ignore[arg-type]  # also NumPy's; what is none is said
    except (TypeError, ValueError, OverflowError):
        raise AutonomyFault(f"returned a setpoint whose {name} contains {_kind(given)}") from None
    if not math.isfinite(number):
        raise AutonomyFault(f"returned a setpoint whose {name} is not finite ({number})")
    if abs(number) > _LARGEST:
        raise AutonomyFault(f"returned a setpoint whose {name} is beyond {_LARGEST:g} ({number:g})")
    return number


@contextmanager
def _alarm(after_s: float) -> Iterator[None]:
    """Raise _HangWarning in an autonomy call whose time is up, and again each second.

    Needs the main thread, where signals arrive; elsewhere there is no limit. A timer that
    somebody else has set goes on afterwards.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, _warn_of_hang)
    left_s, every_s = signal.setitimer(signal.ITIMER_REAL, after_s, _AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, left_s, every_s)


def _warn_of_hang(number: int, frame: FrameType | None) -> NoReturn:
    """Raise the warning of a hanging autonomy call (signal handler)."""
    del number, frame
    raise _HangWarning


def _kind(thing: object) -> str:
    """Return the kind of a wrong value in an autonomy's setpoint, in words."""
    return "nothing" if thing is None else f"a {type(thing).__name__}"


def _error_text(error: BaseException) -> str:
    """Return type and message of an autonomy's exception; the type if that fails."""
    try:
        words = str(error)
    except BaseException:  # noqa: BLE001 - the words of the code under test may raise anything
        words = "(its message cannot be shown)"
    text = printable(" ".join(words.split()))[:_LONGEST_TEXT]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _place_of(error: BaseException) -> str:
    """Return the innermost line of the autonomy's code in a traceback, with its text.

    Where a library of Python or of others raised, the line that called it is what can be mended.
    """
    frames = _frames(error)
    own = [frame for frame in frames if not _is_library(frame.filename)] or frames
    if not own:
        return "no place"
    last = own[-1]
    line = printable(last.line or "")[:_LONGEST_LINE]
    return f"{last.filename}:{last.lineno}" + (f", `{line}`" if line else "")


def _trace(error: BaseException) -> str:
    """Return an autonomy call's traceback, from its own first line on."""
    lines = traceback.format_list(_frames(error))
    return "\n".join(map(printable, "".join([*lines, _error_text(error)]).splitlines()))[
        -_LONGEST_TRACE:
    ]


def _frames(error: BaseException) -> list[traceback.FrameSummary]:
    """Return the traceback frames of an autonomy call outside this module."""
    found = traceback.extract_tb(error.__traceback__, limit=None)
    return [frame for frame in found if frame.filename != __file__]


def _is_library(filename: str) -> bool:
    """Return whether a traceback's file is a library, not the autonomy's code."""
    path = Path(filename)
    if any(path.is_relative_to(ours) for ours in _OURS):
        return not path.is_relative_to(_SHIPPED)
    installed = not {"site-packages", "dist-packages"}.isdisjoint(path.parts)
    return filename.startswith("<") or installed or path.is_relative_to(_STANDARD_LIBRARY)
