"""Calls of the autonomy under test: each returns a checked command or raises AutonomyFault."""

import inspect
import math
import signal
import sysconfig
import threading
import time
import traceback
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from types import FrameType
from typing import Literal, TypeVar

import numpy as np

from wil_campaign.campaigns.values.autonomy_limits import LONGEST_CALL_S
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Vec3

T = TypeVar("T")

_MEMORY_REMEDY = "ask for less, or raise autonomy.limits.memory_mb"
_AGAIN_S = 1.0
_LONGEST_TEXT = 300
_LONGEST_NOTE = 80
_LONGEST_LINE = 100
_LONGEST_TRACE = 8000
_STANDARD_LIBRARY = Path(sysconfig.get_path("stdlib"))
_OURS = Path(__file__).parents[3]
"""The package wil_campaign: a library to the autonomy, also when run from its sources."""
_SHIPPED = _OURS / "campaigns" / "autonomies"
"""The autonomies shipped with wil-campaign: under test like a user's."""
_LARGEST = 1e6
"""Largest setpoint value: metres or metres per second; well within a 32-bit float of MAVLink."""


class AutonomyFault(Exception):  # noqa: N818 - it is what is under test that failed
    """The autonomy under test failed in a call; the message says how, and where in its code.

    trace: the traceback of its exception; empty without one. kind: the verdict of a run that has no
    goal yet; ERROR where memory ran out, which proves nothing about the autonomy then.
    """

    def __init__(
        self, message: str, trace: str = "", kind: Literal["FAIL", "ERROR"] = "FAIL"
    ) -> None:
        super().__init__(message)
        self.trace = trace
        self.kind: Literal["FAIL", "ERROR"] = kind


class HangWarning(BaseException):
    """Raised in the autonomy's code when a call hangs; `except Exception` does not catch it."""


def call_autonomy(
    call: Callable[[], T], *, within_s: float = LONGEST_CALL_S, limit: str = "call_s"
) -> T:
    """Return the result of a call of the autonomy. Raises AutonomyFault, and nothing else.

    limit: name of the limit in `autonomy.limits` that within_s is. SystemExit, KeyboardInterrupt
    and CancelledError are faults, too: in a call that does not await, only the autonomy's own code
    raises them.
    """
    try:
        return _call_with_alarm(call, within_s)
    except AutonomyFault:
        raise  # of an autonomy that knows how it failed, as one in a process of its own
    except HangWarning as error:
        name = f"autonomy.limits.{limit}"
        place = f" ({_place_of(error)})" if _frames(error) else ""
        reason = f"gave no answer within {within_s:g} s, its limit ({name}){place}"
        raise AutonomyFault(reason, _trace(error)) from None
    except BaseException as error:  # noqa: BLE001 - whatever the code under test raises
        reason = f"{_error_text(error)} ({_place_of(error)})"
        # A module that runs out of memory during its import raises with MemoryError as its cause.
        if isinstance(error, MemoryError) or isinstance(error.__cause__, MemoryError):
            reason = f"was refused memory: {reason}; {_MEMORY_REMEDY}"
            raise AutonomyFault(reason, _trace(error), "ERROR") from None
        raise AutonomyFault(f"crashed: {reason}", _trace(error)) from None


def checked_command(answer: object) -> Command:
    """Return the command that the autonomy's `act` returned, checked. Raises AutonomyFault."""
    if not isinstance(answer, Command):
        raise AutonomyFault(f"returned {_kind(answer)}, not a Command")
    note = answer.note
    if not isinstance(note, str):
        raise AutonomyFault(f"returned a note that is {_kind(note)}, not text")
    done = answer.done
    if not isinstance(done, bool | np.bool_):  # a text such as "no" would count as true
        raise AutonomyFault(f"returned a done that is {_kind(done)}, not True or False")
    return Command(_setpoint(answer.setpoint), bool(done), printable_problem(note)[:_LONGEST_NOTE])


def require_method_ran(answer: object, method: str) -> None:
    """Raise AutonomyFault where an autonomy's method did not run: it is a coroutine or generator.

    It returned at once, with its body still to be run, and nobody would notice.
    """
    if inspect.isawaitable(answer) or inspect.isgenerator(answer) or inspect.isasyncgen(answer):
        if inspect.iscoroutine(answer):
            answer.close()  # else Python warns of it later
        raise AutonomyFault(
            f"returned {_kind(answer)} from {method}, whose body did not run: write a plain "
            "function, without async and yield"
        )


def code_folder(autonomy: object) -> Path | None:
    """Return the folder of the file that an autonomy's class is in; None for one without a file."""
    code = getattr(getattr(type(autonomy), "act", None), "__code__", None)
    return None if code is None else Path(code.co_filename).parent


def fault_beside_calls(error: BaseException, folders: Collection[Path]) -> AutonomyFault | None:
    """Return the fault of an error in a thread, task or callback of the autonomy's own.

    folders: of the autonomies' code. None where the first line of the error, that of the standard
    library aside, is not of a file in one of them.
    """
    first = first_own_file(error)
    if first is None or not any(first.is_relative_to(folder) for folder in folders):
        return None
    reason = f"crashed beside its calls: {_error_text(error)} ({_place_of(error)})"
    return AutonomyFault(reason, _trace(error))


def first_own_file(error: BaseException) -> Path | None:
    """Return the file of an error's first line, that of the standard library aside."""
    frames = (frame for frame in _frames(error) if not _is_standard(frame.filename))
    first = next(frames, None)
    return None if first is None else Path(first.filename)


def _setpoint(value: object) -> Setpoint:
    match value:
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
    raise AutonomyFault(f"returned a Command whose setpoint is {_kind(value)}")


def _vector(name: str, value: Sequence[object]) -> Vec3:
    """Return a vector of the autonomy's setpoint, checked. Raises AutonomyFault."""
    try:
        north, east, down = value
    except Exception as error:  # noqa: BLE001 - whatever a type of the code under test raises
        raise _fault_of(error, f"returned a setpoint whose {name} is not three numbers") from None
    return (_number(name, north), _number(name, east), _number(name, down))


def _optional(name: str, value: object) -> float | None:
    """Return an optional number of the autonomy's setpoint; None for None."""
    return None if value is None else _number(name, value)


def _number(name: str, value: object) -> float:
    # float() takes digits in bytes, and False as 0: a yaw_rad of it would turn to the north.
    if isinstance(value, str | bytes | bytearray | bool | np.bool_):
        raise AutonomyFault(f"returned a setpoint whose {name} contains {_kind(value)}")
    try:
        number = float(value)  # type: ignore[arg-type]  # also NumPy's; others are refused
    except Exception as error:  # noqa: BLE001 - whatever a type of the code under test raises
        raise _fault_of(
            error, f"returned a setpoint whose {name} contains {_kind(value)}"
        ) from None
    if not math.isfinite(number):
        raise AutonomyFault(f"returned a setpoint whose {name} is not finite ({number})")
    if abs(number) > _LARGEST:
        raise AutonomyFault(f"returned a setpoint whose {name} is beyond {_LARGEST:g} ({number:g})")
    return number


def _fault_of(error: Exception, text: str) -> AutonomyFault:
    return AutonomyFault(text, kind="ERROR" if isinstance(error, MemoryError) else "FAIL")


def _call_with_alarm(call: Callable[[], T], after_s: float) -> T:
    """Return a call's result; raise HangWarning in it when its time is up, and again each second.

    Needs the main thread, where signals arrive; elsewhere there is no limit. A timer that other
    code has set continues afterwards.
    """
    if threading.current_thread() is not threading.main_thread():
        return call()
    before = signal.signal(signal.SIGALRM, _warn_of_hang)
    began_s = time.monotonic()
    left_s, every_s = signal.setitimer(signal.ITIMER_REAL, after_s, _AGAIN_S)
    try:
        answer = call()
        # Of a call whose last act is a long operation in C the alarm comes when that is over: here.
        if time.monotonic() - began_s > after_s:
            raise HangWarning
        return answer
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, left_s, every_s)


def _warn_of_hang(number: int, frame: FrameType | None) -> None:
    """Raise the warning of a hanging autonomy call (signal handler).

    Not in this module: an exception while the timer is being switched off would leave it on.
    """
    del number
    if frame is None or frame.f_code.co_filename != __file__:
        raise HangWarning


def _kind(value: object) -> str:
    """Return the type of a wrong value from the autonomy, in words."""
    return "nothing" if value is None else f"a {type(value).__name__}"


def _error_text(error: BaseException) -> str:
    """Return type and message of an autonomy's exception, also where its __str__ raises."""
    try:
        message = str(error)
    except BaseException:  # noqa: BLE001 - __str__ of the code under test may raise anything
        message = "(its message cannot be shown)"
    text = printable_problem(" ".join(message.split()))[:_LONGEST_TEXT]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _place_of(error: BaseException) -> str:
    """Return the innermost line of the autonomy's code in an exception's traceback."""
    frames = _frames(error)
    return frames_in_words(frames) or frames_in_words(frames, libraries=True) or "location unknown"


def frames_in_words(frames: Sequence[traceback.FrameSummary], *, libraries: bool = False) -> str:
    """Return the innermost line of the autonomy's code among frames, with its text; "" for none.

    Where the standard library or an installed package is at work, it is the line that called it,
    unless `libraries` count too.
    """
    own = [frame for frame in frames if libraries or not _is_library(frame.filename)]
    if not own:
        return ""
    last = own[-1]
    line = printable_problem(last.line or "")[:_LONGEST_LINE]
    return f"{last.filename}:{last.lineno}" + (f", `{line}`" if line else "")


def _trace(error: BaseException) -> str:
    """Return an autonomy call's traceback, from its own first line on."""
    lines = traceback.format_list(_frames(error))
    return "\n".join(map(printable_problem, "".join([*lines, _error_text(error)]).splitlines()))[
        -_LONGEST_TRACE:
    ]


def _frames(error: BaseException) -> list[traceback.FrameSummary]:
    """Return the traceback frames of an autonomy call outside this module."""
    frames = traceback.extract_tb(error.__traceback__)
    return [frame for frame in frames if frame.filename != __file__]


def _is_library(filename: str) -> bool:
    """Return whether a traceback's file is a library, not the autonomy's code."""
    path = Path(filename)
    if path.is_relative_to(_OURS):
        return not path.is_relative_to(_SHIPPED)
    installed = not {"site-packages", "dist-packages"}.isdisjoint(path.parts)
    return installed or _is_standard(filename)


def _is_standard(filename: str) -> bool:
    """Return whether a traceback's file is of the standard library, or no file."""
    path = Path(filename)
    installed = not {"site-packages", "dist-packages"}.isdisjoint(path.parts)
    is_beneath = path.is_relative_to(_STANDARD_LIBRARY) and not installed
    return filename.startswith("<") or is_beneath
