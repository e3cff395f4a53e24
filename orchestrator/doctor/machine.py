"""Clock, serial ports, disk, and what earlier runs left behind."""

import ctypes
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import psutil

from orchestrator.doctor.findings import Finding
from safety.guard.process.orphaned_processes import GuardRecord
from vehicles.driver.onboard.fence_backup import waiting_backups
from vehicles.launch.launch_records import LaunchRecord
from vehicles.links.serial_port import group_of

CLOCK = "clock"
SERIAL = "serial ports"
LEFT = "left over"
DISK = "results"
_TIMEX_BYTES = 208
_TIME_ERROR = 5
"""adjtimex(2): what it returns while nobody keeps the clock right."""
_NAPS, _NAP_S = 25, 0.002
_LATE_S = 0.005
_LEAST_FREE_BYTES = 2_000_000_000
_OLDEST_YEAR = 2025


def clock(late_s: float, *, synchronised: bool | None, now: datetime) -> Iterator[Finding]:
    """Yield findings whether this machine's clocks are good enough.

    late_s: how much later than asked a process wakes (see `wakes_late_s`). synchronised: None
    where unknown.
    """
    text = f"wakes up {late_s * 1e3:.1f} ms late"
    if late_s > _LATE_S:
        said = "end other programs: setpoints at 50 Hz are 20 ms apart"
        yield Finding(CLOCK, "trouble", text, said)
    else:
        yield Finding(CLOCK, "good", text)
    if now.year < _OLDEST_YEAR:
        said = "set it: signed links refuse what is out of date, and logs carry its time"
        yield Finding(CLOCK, "trouble", f"the date is {now:%Y-%m-%d}", said)
    elif synchronised is False:
        yield Finding(
            CLOCK,
            "note",
            "the system clock is not synchronised",
            "only recordings of several machines and signing need it: timedatectl set-ntp true",
        )
    elif synchronised:
        yield Finding(CLOCK, "good", "the system clock is synchronised")


def wakes_late_s() -> float:
    """Return by how much this machine oversleeps: the 9th of 10 naps, in seconds."""
    late: list[float] = []
    for _ in range(_NAPS):
        asked_s = time.monotonic() + _NAP_S
        time.sleep(_NAP_S)
        late.append(time.monotonic() - asked_s)
    return sorted(late)[_NAPS * 9 // 10]


def guard_scheduling(granted: str) -> Iterator[Finding]:
    """Yield the finding how the guard's process is scheduled here (see `granted_scheduling`)."""
    text = f"the guard's process runs with {granted} scheduling"
    if granted == "real-time":
        yield Finding(CLOCK, "good", text)
    else:
        said = (
            "it comes before other programs once the user may: a line like `NAME - rtprio 1` in "
            "/etc/security/limits.d, and log in again"
        )
        yield Finding(CLOCK, "note", text, said)


def granted_scheduling() -> str:
    """Return what a guard's process is granted, tried in a process that ends at once."""
    program = "from vehicles.processes.linux import rise_above_load; print(rise_above_load())"
    asked = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", program], capture_output=True, check=False, text=True
    )
    return asked.stdout.strip() or "normal"


def clock_synchronised() -> bool | None:
    """Return whether the machine's clock is synchronised (NTP, PTP); None: unknown."""
    try:
        kept = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    except (OSError, AttributeError):
        return None
    return None if kept < 0 else bool(kept != _TIME_ERROR)


def utc() -> datetime:
    """Return the machine's clock in UTC."""
    return datetime.now(UTC)


def serial(devices: Iterable[str]) -> Iterator[Finding]:
    """Yield findings on the machine's serial ports, and whether we may open them."""
    there = tuple(devices)
    if not there:
        yield Finding(SERIAL, "note", "none is plugged in")
    for device in there:
        if os.access(device, os.R_OK | os.W_OK):
            yield Finding(SERIAL, "good", f"link: serial://{device}:57600 (or its own baud rate)")
            continue
        yield Finding(
            SERIAL,
            "trouble",
            f"no permission for {device}",
            f"sudo usermod -aG {group_of(device)} $USER, and log in again",
        )
    if there and _runs("ModemManager"):
        yield Finding(
            SERIAL,
            "note",
            "ModemManager runs: it talks to what is plugged in for some seconds",
            "sudo systemctl disable --now ModemManager, or wait half a minute after plugging in",
        )


def orphans(
    launches: Iterable[LaunchRecord], guards: Iterable[GuardRecord], journals: Path
) -> Iterator[Finding]:
    """Yield findings on orphans: simulators, vehicles, parameters that were not restored.

    guards: records of all guards; of those that live nothing is left over.
    """
    found = [*_simulators(launches), *_vehicles(guards), *_parameters(journals)]
    yield from found or [Finding(LEFT, "good", "nothing")]


def _simulators(launches: Iterable[LaunchRecord]) -> Iterator[Finding]:
    """Yield findings on simulators of earlier runs that still run on this machine."""
    for one in launches:
        pids = " ".join(str(process.pid) for process in one.survivors())
        yield Finding(LEFT, "trouble", f"{one.label} of {one.folder} runs on", f"kill {pids}")


def _vehicles(guards: Iterable[GuardRecord]) -> Iterator[Finding]:
    """Yield findings on embedded vehicles that lost guard and orchestrator."""
    for one in guards:
        alive = [child.pid for child in one.children if child.lives]
        if alive and not one.guard.lives and not (one.owner is not None and one.owner.lives):
            pids = ", ".join(map(str, alive))
            text = f"vehicles of {one.run} in {one.folder} run on (processes {pids})"
            yield Finding(LEFT, "trouble", text, "the next run ends them; or kill them yourself")


def _parameters(journals: Path) -> Iterator[Finding]:
    """Yield the finding on parameter backups that wait to be restored."""
    if there := waiting_backups(journals):
        yield Finding(
            LEFT,
            "note",
            f"parameters of attached vehicles to set back: {', '.join(map(str, there))}",
            "the next run on that vehicle does, before it arms; one that flies now does itself",
        )


def _runs(name: str) -> bool:
    """Return whether a process of this name runs on this machine."""
    return any(process.info["name"] == name for process in psutil.process_iter(["name"]))


def disk(folder: Path) -> Iterator[Finding]:
    """Yield findings whether results can be written to a folder of this machine."""
    if not os.access(folder, os.W_OK):
        said = "give another folder by --out"
        yield Finding(DISK, "trouble", f"{folder} cannot be written to", said)
        return
    free = shutil.disk_usage(folder).free
    text = f"{free / 1e9:.0f} GB free in {folder}"
    if free < _LEAST_FREE_BYTES:
        said = "make room: a run records about 1 MB a second of pictures"
        yield Finding(DISK, "trouble", text, said)
    else:
        yield Finding(DISK, "good", text)
