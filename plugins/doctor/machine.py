"""Checks of clock, serial ports, folders, disk, and orphaned processes of earlier runs."""

import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import psutil

from wil_campaign.foundation.files.paths import is_folder, path_exists, require_utf8
from wil_campaign.foundation.files.problems import BadInput
from wil_campaign.orchestrator.run.flight.lateness import LATE_S
from wil_campaign.plugins.doctor.findings import Finding
from wil_campaign.plugins.firmware.launch_records import LaunchRecord
from wil_campaign.plugins.stream_links.serial_port import serial_port_group
from wil_campaign.safety.guard.process.orphaned_processes import GuardRecord
from wil_campaign.safety.guard.process.runtime_folder import (
    RuntimeFolderError,
    is_too_long,
    open_runtime_folder,
)
from wil_campaign.vehicles.driver.onboard.fence_backup import waiting_backups
from wil_campaign.worlds.jit import KernelCache

CLOCK = "clock"
SERIAL = "serial ports"
LEFT = "left over"
DISK = "results"
KERNELS = "kernels"
SOCKETS = "sockets"
_TIMEX_BYTES = 208
_TIME_ERROR = 5
"""TIME_ERROR of adjtimex(2): the clock is not synchronised."""
_NAPS, _NAP_S = 25, 0.002
_LATE_S = 0.005
_PERIODS, _PERIOD_S = 50, 0.02
_LEAST_FREE_BYTES = 2_000_000_000
_OLDEST_YEAR = 2025


def clock_findings(
    late_s: float, *, stalled_s: float, synchronised: bool | None, now: datetime
) -> Iterator[Finding]:
    """Yield findings on wake-up latency, date and synchronisation of the clock.

    late_s: the wake-up latency of a process (see `wakes_late_s`); stalled_s: its longest stall (see
    `stalls_s`). synchronised: None where unknown.
    """
    text = f"wakes up {late_s * 1e3:.1f} ms late"
    if late_s > _LATE_S:
        remedy = "end other programs: setpoints at 50 Hz are 20 ms apart"
        yield Finding(CLOCK, "trouble", text, remedy)
    else:
        yield Finding(CLOCK, "good", text)
    text = f"a program with a period of 20 ms was late by up to {stalled_s * 1e3:.0f} ms"
    if stalled_s >= LATE_S:
        why = "such a flight on the wall clock is INVALID for this machine"
        remedy = f"{why}: end other programs, or fly what is embedded by --clock virtual"
        yield Finding(CLOCK, "trouble", text, remedy)
    else:
        yield Finding(CLOCK, "good", text)
    if now.year < _OLDEST_YEAR:
        remedy = "set the clock: signed links reject old timestamps, and logs have its time"
        yield Finding(CLOCK, "trouble", f"the date is {now:%Y-%m-%d}", remedy)
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
    """Return the 90th percentile of how much this machine oversleeps, in seconds."""
    late: list[float] = []
    for _ in range(_NAPS):
        due_s = time.monotonic() + _NAP_S
        time.sleep(_NAP_S)
        late.append(time.monotonic() - due_s)
    return sorted(late)[_NAPS * 9 // 10]


def stalls_s() -> float:
    """Return by how much a program with a period of 20 ms was late at most within a second."""
    worst_s, due_s = 0.0, time.monotonic()
    for _ in range(_PERIODS):
        due_s += _PERIOD_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        worst_s = max(worst_s, time.monotonic() - due_s)
        due_s = max(due_s, time.monotonic())
    return worst_s


def guard_privileges(scheduling: str, *, in_memory: bool) -> Iterator[Finding]:
    """Yield the findings on what the system grants the guard's process (`granted_to_guard`)."""
    remedy = "add a line like `NAME - %s` to /etc/security/limits.d, and log in again"
    text = f"the guard's process runs with {scheduling} scheduling"
    if scheduling == "real-time":
        yield Finding(CLOCK, "good", text)
    else:
        why = "to give it priority over other programs: "
        yield Finding(CLOCK, "note", text, why + remedy % "rtprio 1")
    if in_memory:
        yield Finding(CLOCK, "good", "the guard's process stays in memory")
    else:
        text = "a machine short of memory may hold up the guard's process"
        yield Finding(CLOCK, "note", text, "to keep it in memory: " + remedy % "memlock unlimited")


def granted_to_guard() -> tuple[str, bool]:
    """Return the scheduling that the system grants to a guard, and whether it stays in memory.

    Tried in a short process.
    """
    names = "raise_process_priority, lock_process_memory"
    program = f"from wil_campaign.foundation.processes.linux import {names}; "
    program += "print(raise_process_priority(), lock_process_memory(), sep='\\n')"
    result = subprocess.run(  # noqa: S603 - this interpreter
        [sys.executable, "-P", "-c", program], capture_output=True, check=False, text=True
    )
    scheduling, _, in_memory = result.stdout.strip().partition("\n")
    return scheduling or "normal", in_memory == "True"


def clock_synchronised() -> bool | None:
    """Return whether the machine's clock is synchronised (NTP, PTP); None: unknown."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else bool(state != _TIME_ERROR)


def clock_utc() -> datetime:
    """Return the machine's clock in UTC."""
    return datetime.now(UTC)


def serial_port_findings(devices: Iterable[str]) -> Iterator[Finding]:
    """Yield findings on serial ports, and whether this user may open them."""
    there = tuple(devices)
    if not there:
        yield Finding(SERIAL, "note", "no serial device is plugged in")
    for device in there:
        if os.access(device, os.R_OK | os.W_OK):
            yield Finding(SERIAL, "good", f"link: serial://{device}:57600 (or its own baud rate)")
            continue
        yield Finding(
            SERIAL,
            "trouble",
            f"no permission for {device}",
            f"sudo usermod -aG {serial_port_group(device)} $USER, and log in again",
        )
    if there and _runs("ModemManager"):
        yield Finding(
            SERIAL,
            "note",
            "ModemManager runs: it sends to a newly plugged device for some seconds",
            "sudo systemctl disable --now ModemManager, or wait half a minute after plugging in",
        )


def orphan_findings(
    launches: Iterable[LaunchRecord], guards: Iterable[GuardRecord], backups: Path | None
) -> Iterator[Finding]:
    """Yield findings on orphans: simulators, vehicles, parameters that were not restored.

    guards: records of all guards; vehicles of a live guard are not orphans. backups: the folder of
    parameter backups; None where this user can have none.
    """
    parameters = () if backups is None else _parameters(backups)
    found = [*_simulators(launches), *_vehicles(guards), *parameters]
    yield from found or [Finding(LEFT, "good", "nothing")]


def _simulators(launches: Iterable[LaunchRecord]) -> Iterator[Finding]:
    """Yield findings on simulators of earlier runs that still run."""
    for launch in launches:
        pids = " ".join(str(process.pid) for process in launch.survivors())
        yield Finding(
            LEFT, "trouble", f"{launch.label} of {launch.folder} still runs", f"kill {pids}"
        )


def _vehicles(guards: Iterable[GuardRecord]) -> Iterator[Finding]:
    for guard in guards:
        alive = [child.pid for child in guard.children if child.lives]
        if alive and not guard.guard.lives and not (guard.owner is not None and guard.owner.lives):
            pids = ", ".join(map(str, alive))
            text = f"vehicles of {guard.run} in {guard.folder} still run (processes {pids})"
            yield Finding(LEFT, "trouble", text, "the next run ends them; or kill them")


def _parameters(backups: Path) -> Iterator[Finding]:
    """Yield the finding on parameter backups that wait to be restored."""
    if there := waiting_backups(backups):
        text = f"parameters of attached vehicles to restore: {', '.join(map(str, there))}"
        remedy = "the next run with that vehicle restores them before arming, or the one in flight"
        yield Finding(LEFT, "note", text, remedy)


def _runs(name: str) -> bool:
    return any(process.info["name"] == name for process in psutil.process_iter(["name"]))


def kernel_cache_finding(cache: KernelCache) -> Iterator[Finding]:
    """Yield the finding where JIT-compiled kernels are cached, and whether that is writable."""
    why = "; ".join(cache.passed_over)
    remedy = "set NUMBA_CACHE_DIR to a folder of your own that is kept"
    if cache.folder is None:
        text = f"compiled kernels are cached nowhere, each process compiles for a minute: {why}"
        yield Finding(KERNELS, "note", text, remedy)
    elif cache.folder.parent == Path(tempfile.gettempdir()):
        text = f"compiled kernels are cached in {cache.folder}, which may not be kept: {why}"
        yield Finding(KERNELS, "note", text, remedy)
    else:
        text = f"compiled kernels are cached in {cache.folder}, which is writable"
        yield Finding(KERNELS, "good", text)


def socket_folder_finding() -> Iterator[Finding]:
    """Yield the finding on the folder of sockets."""
    try:
        folder = open_runtime_folder().path
    except RuntimeFolderError as error:
        yield Finding(SOCKETS, "trouble", str(error))
        return
    base = os.environ.get("XDG_RUNTIME_DIR")
    if base and is_too_long(base):
        text = f"XDG_RUNTIME_DIR is too long for paths of sockets; {folder} is used"
        yield Finding(SOCKETS, "note", text)
    else:
        yield Finding(SOCKETS, "good", f"sockets are in {folder}")


def disk_finding(results: Path) -> Iterator[Finding]:
    """Yield the finding whether results can be written to a folder."""
    try:
        require_utf8(results)
    except BadInput as error:
        yield Finding(DISK, "trouble", str(error))
        return
    folder = next((path for path in (results, *results.parents) if path_exists(path)), Path())
    if not is_folder(folder):
        yield Finding(DISK, "trouble", f"{folder} is no folder", "give another folder by --out")
        return
    if not os.access(folder, os.W_OK):
        remedy = "give another folder by --out"
        yield Finding(DISK, "trouble", f"{folder} is not writable", remedy)
        return
    free = shutil.disk_usage(folder).free
    text = f"{free / 1e9:.0f} GB free in {folder}"
    if free < _LEAST_FREE_BYTES:
        remedy = "free disk space: a run records about 1 MB of images per second"
        yield Finding(DISK, "trouble", text, remedy)
    else:
        yield Finding(DISK, "good", text)
