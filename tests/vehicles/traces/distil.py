"""Distils a .tlog of the reference script into a small time line: `distil.py TLOG > GOLDEN.json`.

The script is boot, readiness, arm, takeoff to 5 m, 2 m/s north for 5 s, setpoints stopped, land,
disarm. What is kept: who it is, the order of modes, landed states, readiness, texts and
acknowledgements, and how the flight went. Every event carries the anchor that it followed (boot,
armed, flying, stopped, land, landed) and the seconds since, on the vehicle's own clock.
"""

import json
import math
import re
import struct
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ARM, SET_MODE, INTERVAL, REQUEST = 400, 176, 511, 512
COPTER_LAND, PX4_LAND = 9.0, 6.0
RATES_FROM_S = 4.0
LAND_BAND_M = (3.5, 1.5)
"""Heights between which the descent speed is taken."""


@dataclass
class Timeline:
    """What a flight came to; each event is [anchor, seconds since, *what]."""

    identity: dict[str, int] = field(default_factory=dict)
    modes: list[list[Any]] = field(default_factory=list)
    landed: list[list[Any]] = field(default_factory=list)
    prearm: list[list[Any]] = field(default_factory=list)
    estimator: list[list[Any]] = field(default_factory=list)
    gps: list[list[Any]] = field(default_factory=list)
    texts: list[list[Any]] = field(default_factory=list)
    acks: list[list[Any]] = field(default_factory=list)
    first_local_position: list[Any] = field(default_factory=list)
    rates_hz: dict[str, float] = field(default_factory=dict)
    flight: dict[str, float] = field(default_factory=dict)


def read_tlog(path: Path) -> Iterator[tuple[float, bytes]]:
    """Yield (seconds, frame) of a .tlog: 8 bytes of big-endian microseconds, then the frame."""
    data = path.read_bytes()
    at = 0
    while at + 10 <= len(data):
        (stamp_us,) = struct.unpack_from(">Q", data, at)
        at += 8
        signed = 13 if data[at + 2] & 1 else 0
        length = data[at + 1] + 12 + signed if data[at] == 0xFD else data[at + 1] + 8
        yield stamp_us / 1e6, data[at : at + length]
        at += length


def messages(frames: Iterable[tuple[float, bytes]]) -> Iterator[tuple[float, Any]]:
    """Yield (seconds, message); frames that the dialect does not know are left out."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    for t_s, frame in frames:
        for message in parser.parse_buffer(frame) or ():
            if message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN"):
                yield t_s, message


class Distiller:
    """Takes messages in order and keeps what counts."""

    def __init__(self) -> None:
        self.line = Timeline()
        self.anchors: dict[str, float] = {"boot": 0.0}
        self._wall_s = 0.0
        self._clock: tuple[float, float] | None = None
        self._early: list[list[Any]] = []
        self._counts: Counter[str] = Counter()
        self._track: list[tuple[float, float, float, float]] = []
        self._texts: dict[int, list[Any]] = {}
        self._last_setpoint_s: float | None = None

    def take(self, wall_s: float, message: Any) -> None:
        """Take the next message; wall_s is when it was seen."""
        self._wall_s = wall_s
        if message.get_srcSystem() == 250:
            self._from_script(message)
            return
        boot_ms = getattr(message, "time_boot_ms", 0)
        if boot_ms:
            self._set_clock(boot_ms / 1e3)
        self._stop_if_silent()
        handler = getattr(self, f"_on_{message.get_type().lower()}", None)
        if handler is not None:
            handler(message)
        if self._clock is not None and self._now_s() >= RATES_FROM_S:
            self._counts[message.get_type()] += 1

    def finish(self) -> Timeline:
        """Return the time line."""
        span_s = self._now_s() - RATES_FROM_S
        self.line.rates_hz = {
            name: round(count / span_s, 2) for name, count in sorted(self._counts.items())
        }
        self.line.flight = self._flight()
        return self.line

    def _set_clock(self, boot_s: float) -> None:
        first = self._clock is None
        if self._clock is None or boot_s > self._clock[0]:
            self._clock = (boot_s, self._wall_s)
        if first:
            for event in self._early:
                event[1] = round(boot_s - (self._wall_s - event[1]), 2)

    def _now_s(self) -> float:
        if self._clock is None:
            return 0.0
        boot_s, seen_s = self._clock
        return boot_s + min(0.05, self._wall_s - seen_s)

    def _stop_if_silent(self) -> None:
        """Set the anchor of stopped setpoints: half a second after the last one it is known."""
        last_s = self._last_setpoint_s
        if last_s is not None and self._now_s() - last_s > 0.5:
            self.anchors.setdefault("stopped", last_s)

    def _event(self, *what: Any) -> list[Any]:
        if self._clock is None:
            event = ["boot", self._wall_s, *what]
            self._early.append(event)
            return event
        now_s = self._now_s()
        anchor = max(self.anchors, key=lambda name: self.anchors[name])
        return [anchor, round(now_s - self.anchors[anchor], 2), *what]

    def _changed(self, events: list[list[Any]], *what: Any) -> None:
        if not events or events[-1][2:] != list(what):
            events.append(self._event(*what))

    # What the script did.

    def _from_script(self, message: Any) -> None:
        if message.get_type() != "SET_POSITION_TARGET_LOCAL_NED":
            return
        if message.vx > 0.0:
            self.anchors.setdefault("flying", self._now_s())
            self._last_setpoint_s = self._now_s()

    # What the vehicle said.

    def _on_heartbeat(self, m: Any) -> None:
        self.line.identity.setdefault("type", m.type)
        self.line.identity.setdefault("autopilot", m.autopilot)
        self.line.identity.setdefault("component", m.get_srcComponent())
        self._changed(self.line.modes, m.base_mode, m.custom_mode, m.system_status)

    def _on_autopilot_version(self, m: Any) -> None:
        for name in ("capabilities", "flight_sw_version", "uid"):
            self.line.identity[name] = getattr(m, name)

    def _on_extended_sys_state(self, m: Any) -> None:
        before = len(self.line.landed)
        self._changed(self.line.landed, m.landed_state)
        if len(self.line.landed) > before and m.landed_state == 1 and "land" in self.anchors:
            self.anchors.setdefault("landed", self._now_s())

    def _on_sys_status(self, m: Any) -> None:
        healthy = bool(m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        self._changed(self.line.prearm, healthy)

    def _on_ekf_status_report(self, m: Any) -> None:
        self._changed(self.line.estimator, m.flags)

    def _on_estimator_status(self, m: Any) -> None:
        self._changed(self.line.estimator, m.flags)

    def _on_gps_raw_int(self, m: Any) -> None:
        self._changed(self.line.gps, m.fix_type, m.satellites_visible)

    def _on_statustext(self, m: Any) -> None:
        if m.id and m.chunk_seq:
            self._texts[m.id][-1] = plain(self._texts[m.id][-1] + m.text)
            return
        event = self._event(m.severity, plain(m.text))
        self._texts[m.id] = event
        # A file name of its own log: it says nothing of behaviour.
        if not m.text.startswith("[logger]"):
            self.line.texts.append(event)

    def _on_command_ack(self, m: Any) -> None:
        if m.command in {INTERVAL, REQUEST} or m.target_system != 250:
            return
        self.line.acks.append(self._event(m.command, m.result))
        if m.command == ARM:
            self.anchors["armed"] = self._now_s()
        if m.command == SET_MODE and "stopped" in self.anchors:
            self.anchors["land"] = self._now_s()

    def _on_local_position_ned(self, m: Any) -> None:
        if not self.line.first_local_position:
            self.line.first_local_position = self._event()
        self._track.append((m.time_boot_ms / 1e3, m.x, -m.z, math.hypot(m.vx, m.vy)))

    def _flight(self) -> dict[str, float]:
        a, track = self.anchors, self._track
        ground_m = next(up for t, _, up, _ in track if t >= a["armed"])
        lift = next(t for t, _, up, _ in track if t > a["armed"] and up - ground_m > 0.3)
        high = next(t for t, _, up, _ in track if t > a["armed"] and up - ground_m > 4.0)
        hover = [up - ground_m for t, _, up, _ in track if high < t < a["flying"]]
        flown = [(t, x, v) for t, x, _, v in track if a["flying"] <= t <= a["stopped"]]
        slow = next(t for t, _, _, v in track if t > a["stopped"] and v < 1.0)
        top, bottom = LAND_BAND_M
        last_top = max(t for t, _, up, _ in track if t > a["land"] and up - ground_m > top)
        first_bottom = min(t for t, _, up, _ in track if t > last_top and up - ground_m < bottom)
        return {
            "lift_after_arm_s": round(lift - a["armed"], 2),
            "climb_to_4_m_s": round(high - lift, 2),
            "highest_before_flying_m": round(max(hover), 2),
            "moved_north_m": round(flown[-1][1] - flown[0][1], 2),
            "speed_when_stopped_m_s": round(flown[-1][2], 2),
            "slower_than_1_m_s_after_stop_s": round(slow - a["stopped"], 2),
            "descent_m_s": round((top - bottom) / (first_bottom - last_top), 2),
        }


def plain(text: str) -> str:
    """Return a text without the numbers that differ from flight to flight, and without its tab."""
    text = re.sub(r"(?<=start return at )\d+ m \(\d+", "# m (#", text)
    text = re.sub(r"(?<=Hit ground at )[\d.]+", "#", text)
    return text.rstrip("\t")


def distil(frames: Iterable[tuple[float, bytes]]) -> Timeline:
    """Return the time line of frames of both directions, in the order of their times."""
    distiller = Distiller()
    for wall_s, message in messages(frames):
        distiller.take(wall_s, message)
    return distiller.finish()


def main() -> None:
    line = asdict(distil(read_tlog(Path(sys.argv[1]))))
    rows = []
    for name, value in line.items():
        if isinstance(value, list) and value and isinstance(value[0], list):
            body = ",\n    ".join(json.dumps(event) for event in value)
            rows.append(f'  "{name}": [\n    {body}\n  ]')
        else:
            rows.append(f'  "{name}": {json.dumps(value)}')
    sys.stdout.write("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    main()
