"""Linux features that vehicles in processes of their own need; refused on other systems."""

import contextlib
import ctypes
import math
import os
import resource
import signal
import socket
import struct
import sys
import tempfile
from collections.abc import Sequence
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


def show_process_command(argv: Sequence[str]) -> None:
    """Have /proc show a command line as that of this process (Linux).

    It replaces the words that the process was started with where they stand in memory, by
    arg_start and arg_end of proc_pid_stat(5), if there is room; spaces fill the rest.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        begin, end = int(fields[45]), int(fields[46])
        words = b"\0".join(map(os.fsencode, argv))
        room = end - begin - 1
        if begin and len(words) <= room:
            ctypes.memmove(begin, words.ljust(room) + b"\0", room + 1)


def exit_descriptor(pid: int) -> int:
    """Return a Linux file descriptor that is readable when a process has ended.

    Raises UnsupportedSystemError, and OSError where the kernel is older than 5.3.
    """
    if not sys.platform.startswith("linux"):
        raise _refusal("descriptors of processes")
    return os.pidfd_open(pid)


def socket_peer_uid(end: socket.socket) -> int:
    """Return the user at a Unix socket's other end (Linux). Raises UnsupportedSystemError."""
    if not sys.platform.startswith("linux"):
        raise _refusal("the credentials of a socket's peer")
    raw = end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _credentials.size)
    _, uid, _ = _credentials.unpack(raw)
    return int(uid)


def usable_cores() -> int:
    """Return how many cores this process may use, as a container grants them.

    The least of its affinity and of the quota of its control group, of which a started core does
    not count; at least 1. On other systems than Linux all cores.
    """
    if not sys.platform.startswith("linux"):
        return os.cpu_count() or 1
    return max(1, int(min(len(os.sched_getaffinity(0)), cpu_quota())))


def cpu_quota(
    own: Path = Path("/proc/self/cgroup"), mounted: Path = Path("/sys/fs/cgroup")
) -> float:
    """Return how many CPUs the control groups of this process may use; infinity without a quota.

    own: the groups of the process; mounted: the folder of all groups. The least of a group and of
    those above it, by cpu.max of version 2 (cgroup-v2.rst of Linux), or cpu.cfs_quota_us and
    cpu.cfs_period_us of version 1. A container may see the path that its group has on the host,
    where it has its group itself as the uppermost.
    """
    least = math.inf
    with contextlib.suppress(OSError):
        for line in own.read_text().splitlines():
            _, _, rest = line.partition(":")
            controllers, _, path = rest.partition(":")
            if not controllers:
                least = min(least, _least_quota(mounted, path))
            elif "cpu" in controllers.split(","):
                for name in {"cpu", controllers}:
                    least = min(least, _least_quota(mounted / name, path))
    return least


def _least_quota(top: Path, path: str) -> float:
    """Return the least quota of a control group and of those above it, in CPUs."""
    group = top / path.lstrip("/")
    folders = [one for one in (group, *group.parents) if one.is_relative_to(top)]
    return min(map(_quota_of, folders), default=math.inf)


def _quota_of(group: Path) -> float:
    """Return the quota of one control group in CPUs; infinity where it has none."""
    with contextlib.suppress(OSError, ValueError, ZeroDivisionError):
        quota, period = (group / "cpu.max").read_text().split()
        return int(quota) / int(period)
    with contextlib.suppress(OSError, ValueError, ZeroDivisionError):
        quota, period = ((group / f"cpu.cfs_{one}_us").read_text() for one in ("quota", "period"))
        return int(quota) / int(period) if int(quota) > 0 else math.inf
    return math.inf


def memory_descriptor(name: str) -> int:
    """Return a descriptor of memory that processes may share; elsewhere of a file without a name.

    name: as /proc shows it.
    """
    if hasattr(os, "memfd_create"):
        return os.memfd_create(name)
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


def processor_wait_s(pid: int) -> float:
    """Return for how long a process was ready to run but had no processor, in seconds.

    Of its main thread, by the second number of /proc/PID/schedstat (sched-stats.rst of Linux). 0.0
    for a process that has ended, and where the system does not count it.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        file = os.open(f"/proc/{pid}/schedstat", os.O_RDONLY | os.O_CLOEXEC)
        try:
            return int(os.read(file, 256).split()[1]) / 1e9
        finally:
            os.close(file)
    return 0.0


def raise_process_priority() -> str:
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


def lock_process_memory() -> bool:
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
