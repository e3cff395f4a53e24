"""Linux features that vehicles in processes of their own need; refused on other systems."""

import contextlib
import ctypes
import os
import resource
import signal
import socket
import struct
import sys
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_CAP_IPC_LOCK = 14
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_credentials = struct.Struct("3i")
"""struct ucred of unix(7): pid, uid, gid."""


class UnsupportedSystemError(OSError):
    """The system lacks a Linux feature that a run's processes need; says what to do."""


def die_with_parent(number: signal.Signals) -> None:
    """Have the Linux kernel signal this process when its parent process ends.

    Raises UnsupportedSystemError.
    """
    parent = os.getppid()
    _prctl(_PR_SET_PDEATHSIG, number, "signals at the end of a parent process")
    if os.getppid() != parent:
        # The parent ended before the call.
        os.kill(os.getpid(), number)


def adopt_orphans() -> None:
    """Become the parent of orphaned descendants (Linux). Raises UnsupportedSystemError."""
    _prctl(_PR_SET_CHILD_SUBREAPER, 1, "the adoption of orphaned processes")


def exit_descriptor(pid: int) -> int:
    """Return a Linux file descriptor that is readable when a process has ended.

    Raises UnsupportedSystemError, and OSError where the kernel is older than 5.3.
    """
    if not sys.platform.startswith("linux"):
        raise _refusal("descriptors of processes")
    return os.pidfd_open(pid)


def peer_uid(end: socket.socket) -> int:
    """Return the user at a Unix socket's other end (Linux). Raises UnsupportedSystemError."""
    if not sys.platform.startswith("linux"):
        raise _refusal("the credentials of a socket's peer")
    raw = end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _credentials.size)
    _, uid, _ = _credentials.unpack(raw)
    return int(uid)


def usable_cores() -> int:
    """Return how many cores this process may use; on other systems than Linux all cores."""
    if not sys.platform.startswith("linux"):
        return os.cpu_count() or 1
    return len(os.sched_getaffinity(0))


def processor_wait_s(pid: int) -> float:
    """Return for how long a process was ready to run but had no processor, in seconds.

    Of its main thread, by the second number of /proc/PID/schedstat (sched-stats.rst of Linux). 0.0
    for a process that has ended, and where the system does not count it.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        return int(Path(f"/proc/{pid}/schedstat").read_bytes().split()[1]) / 1e9
    return 0.0


def rise_above_load() -> str:
    """Raise this process's scheduling priority; return the scheduling that the system granted.

    "real-time": SCHED_RR at the lowest of its priorities (sched(7)), so that only the kernel and
    other real-time programs come first. "nice -10": a larger share of the processor. "normal": the
    user may have neither; RLIMIT_RTPRIO of 1 or more, or CAP_SYS_NICE, grants the first. Children
    of this process are scheduled normally, at nice 0 or its former value.
    """
    if not sys.platform.startswith("linux"):
        return "normal"
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))
        return "real-time"
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, 0, -10)
        return "nice -10"
    return "normal"


def stay_in_memory() -> bool:
    """Keep what this process uses in RAM from now on; return whether the system permits it.

    Else a machine short of memory reads a program's code from the disk again, each time for
    milliseconds to seconds. Of all its memory (mlockall(2)), so only with CAP_IPC_LOCK or an
    unlimited RLIMIT_MEMLOCK: with a limit, later allocations would fail. Not inherited by children.
    """
    if not sys.platform.startswith("linux"):
        return False
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit != resource.RLIM_INFINITY and not _has_capability(_CAP_IPC_LOCK):
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    return bool(libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0)


def _has_capability(number: int) -> bool:
    """Return whether this process has a capability of capabilities(7)."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        status = Path("/proc/self/status").read_text()
        return bool(int(status.partition("CapEff:")[2].split()[0], 16) >> number & 1)
    return False


def _prctl(option: int, value: int, what: str) -> None:
    """Call Linux's prctl. Raises UnsupportedSystemError, OSError."""
    if not sys.platform.startswith("linux"):
        raise _refusal(what)
    if ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0) != 0:
        error = ctypes.get_errno()
        raise OSError(error, f"prctl({option}): {os.strerror(error)}")


def _refusal(what: str) -> UnsupportedSystemError:
    """Return the error of a system that lacks a Linux feature."""
    return UnsupportedSystemError(
        f"{sys.platform} lacks {what}: only Linux runs vehicles in processes of their own; "
        "use --clock virtual here"
    )
