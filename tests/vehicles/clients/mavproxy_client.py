"""Flies a vehicle with MAVProxy, as a person types; run as a program: URL px4|ardupilot FOLDER.

What MAVProxy prints is heard, and answers are typed. Connects, lists and sets parameters, keeps a
mission and a fence, arms, takes off, goes to a place, lands, lists the logs; a line for each, and
exit code 0 when all of it worked.
"""

import os
import queue
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

from pymavlink import mavutil

PARAMETERS = {"px4": "COM_OF_LOSS_T", "ardupilot": "GUID_TIMEOUT"}
PX4_TAKEOFF, PX4_LAND = "1 4 2", "1 4 6"
"""PX4's modes; `mode` of MAVProxy 1.8.74 fails for PX4: it sends their names as numbers."""
MODULES = "log,wp,fence,param,arm,mode,misc,cmdlong"
WITHIN_S = 40.0
MAVPROXY = Path(sys.executable).parent / "mavproxy.py"


class Typist:
    """MAVProxy in a process, a keyboard and eyes."""

    def __init__(self, url: str, folder: str) -> None:
        self.process = subprocess.Popen(  # noqa: S603 - the program under test
            [
                *(sys.executable, "-u", str(MAVPROXY), "--master", url),
                *("--default-modules", MODULES, "--state-basedir", folder, "--mav20"),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
            env={**os.environ, "HOME": folder},
        )
        self.printed: queue.Queue[str] = queue.Queue()
        self.all: list[str] = []
        threading.Thread(target=self._hear, daemon=True).start()

    def type(self, line: str) -> None:
        """Type a line."""
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def see(self, pattern: str, within_s: float = WITHIN_S) -> re.Match[str]:
        """Wait until something is printed; raises TimeoutError."""
        end_s = time.monotonic() + within_s
        while (left_s := end_s - time.monotonic()) > 0:
            try:
                line = self.printed.get(timeout=left_s)
            except queue.Empty:
                break
            if found := re.search(pattern, line):
                return found
        raise TimeoutError(f"'{pattern}' was not seen; MAVProxy printed:\n{''.join(self.all)}")

    def until_seen(self, line: str, pattern: str, within_s: float = WITHIN_S) -> re.Match[str]:
        """Type a line again and again until something is printed."""
        end_s = time.monotonic() + within_s
        while time.monotonic() < end_s:
            self.type(line)
            try:
                return self.see(pattern, 1.0)
            except TimeoutError:
                continue
        return self.see(pattern, 0.1)

    def _hear(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.all.append(line)
            self.printed.put(line)


def report(text: str) -> None:
    """Tell that something worked."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main(url: str, autopilot: str, folder: str) -> None:
    """Do everything once."""
    person = Typist(url, folder)
    try:
        _fly(person, autopilot, Path(folder))
    finally:
        person.process.kill()
        person.process.wait()


def _fly(person: Typist, autopilot: str, folder: Path) -> None:
    report(f"connected: {person.see('Detected vehicle|online system .*').group(0)}")
    report(f"parameters {person.see('Received ([0-9]+) parameters').group(1)}")
    name = PARAMETERS[autopilot]
    person.type(f"param set {name} 2.5")
    person.until_seen(f"param show {name}", rf"{name}\s+2\.5")
    report("parameter set")
    place = person.until_seen(
        "status GLOBAL_POSITION_INT", r"lat : (-?[1-9]\d+), lon : (-?\d+), alt : (-?\d+)"
    )
    latitude, longitude = (int(place.group(n)) / 1e7 for n in (1, 2))
    _mission(person, folder, latitude, longitude)
    person.until_seen("status SYS_STATUS", "onboard_control_sensors_health : ")
    if autopilot == "ardupilot":
        person.until_seen("mode guided", "Mode GUIDED")
    else:
        person.type("param set MIS_TAKEOFF_ALT 3")
        person.until_seen("param show MIS_TAKEOFF_ALT", r"MIS_TAKEOFF_ALT\s+3")
    person.until_seen("arm throttle", "^ARMED|Arming|ARMED")
    report("armed")
    # MAVProxy's own takeoff names the place 0, 0, to which a PX4 would fly.
    person.type("takeoff 3" if autopilot == "ardupilot" else f"long DO_SET_MODE {PX4_TAKEOFF}")
    person.until_seen(
        "status GLOBAL_POSITION_INT", r"relative_alt : (2[5-9]|3)\d\d\d?\b|relative_alt : 3\d\d\d"
    )
    report("took off")
    north = latitude + 1e-4
    if autopilot == "ardupilot":
        person.type(f"guided {north:.7f} {longitude:.7f} 3")
    else:  # MAVProxy's own is a mission item, which PX4 refuses
        above_m = int(place.group(3)) * 1e-3 + 3.0
        person.type(f"long DO_REPOSITION -1 1 0 nan {north:.7f} {longitude:.7f} {above_m:.1f}")
    person.until_seen("status GLOBAL_POSITION_INT", _near(round(north * 1e7)))
    report("went north")
    person.type("mode land" if autopilot == "ardupilot" else f"long DO_SET_MODE {PX4_LAND}")
    person.see("DISARMED")
    report("landed")
    person.type("log list")
    report(f"log {person.see('Log ([0-9]+)').group(1)}")


def _mission(person: Typist, folder: Path, latitude: float, longitude: float) -> None:
    file = folder / "three.txt"
    lines = ["QGC WPL 110"]
    for number in range(4):
        frame = 0 if number == 0 else 3
        place = f"{latitude + number * 1e-5:.8f}\t{longitude:.8f}\t3"
        lines.append(f"{number}\t{int(number == 0)}\t{frame}\t16\t0\t0\t0\t0\t{place}\t1")
    file.write_text("\n".join(lines) + "\n")
    person.type(f"wp load {file}")
    person.see("Loaded [34] waypoints")
    # To list them before is to give up the upload.
    person.see("MISSION_ACK: TYPE_MISSION: ACCEPTED")
    person.until_seen("wp list", "Requesting [34] waypoints|Saved [34]|16 ")
    report("mission")


def _near(latitude: int) -> str:
    """Return a pattern of a latitude within a metre or so."""
    return "lat : (" + "|".join(str((latitude + d) // 100) for d in range(-100, 101, 100)) + ")"


assert mavutil is not None  # it is what MAVProxy speaks with

if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3])
