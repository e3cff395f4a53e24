"""What only Linux has and runs in processes of their own need; elsewhere it is refused."""

import ctypes
import os
import signal
import socket
import struct
import sys

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_credentials = struct.Struct("3i")
"""struct ucred of unix(7): pid, uid, gid."""


class UnsupportedSystemError(OSError):
    """The system lacks a Linux feature that processes of a run need; what to do."""


def die_with_parent(number: signal.Signals) -> None:
    """Have the Linux kernel signal us when our parent process ends.

    Raises UnsupportedSystemError.
    """
    parent = os.getppid()
    _prctl(_PR_SET_PDEATHSIG, number, "signals at the end of a parent process")
    if os.getppid() != parent:
        # It ended before the kernel was asked.
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
