"""A scripted peer at the other end of a link in memory: says and answers what a test wants."""

import asyncio
import math
from collections.abc import Callable
from typing import Any, Self

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

Reply = Callable[["FakePeer", Any], None]


class FakePeer:
    """An autopilot that is nothing but its script.

    `replies` maps a message type, or "COMMAND_LONG:<number>", to what is done about it; commands
    without a reply are accepted, TIMESYNC is answered by a clock that is `boot_offset_s` ahead.
    """

    def __init__(
        self, link: Link, *, autopilot: int, custom_mode: int = 0, system: int = 1
    ) -> None:
        self.link = link
        self.codec = MavlinkCodec(system_id=system, component_id=1)
        self.autopilot = autopilot
        self.vehicle_type = mavlink.MAV_TYPE_QUADROTOR
        self.custom_mode = custom_mode
        self.armed = False
        self.system_status = mavlink.MAV_STATE_STANDBY
        self.prearm = True
        self.flags = 831
        self.landed_state = 1
        self.battery = 0, 80
        self.boot_offset_s = 100.0
        self.position_ned_m = (0.0, 0.0, 0.0)
        self.yaw_rad = 0.0
        self.muted = False
        self.says_quaternions = True
        self.received: list[Any] = []
        self.replies: dict[str, Reply] = {}
        self.parameters: dict[str, tuple[float, int]] = {}
        self._ticks = 0
        self._timer: asyncio.TimerHandle | None = None
        link.receive(self._arrived)

    async def __aenter__(self) -> Self:
        await self.link.__aenter__()
        self._tick()
        return self

    async def __aexit__(self, *exc: object) -> None:
        assert self._timer is not None
        self._timer.cancel()
        await self.link.__aexit__(None, None, None)

    @property
    def boot_s(self) -> float:
        return asyncio.get_running_loop().time() + self.boot_offset_s

    def say(self, message: Any) -> None:
        if not self.muted:
            self.link.write(self.codec.pack(message))

    def text(self, text: str, severity: int = 4) -> None:
        self.say(mavlink.MAVLink_statustext_message(severity, text.encode()))

    def ack(self, message: Any, result: int = 0) -> None:
        self.say(
            mavlink.MAVLink_command_ack_message(
                message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )

    def commands(self, number: int) -> list[Any]:
        return [
            each
            for each in self.received
            if each.get_type() == "COMMAND_LONG" and each.command == number
        ]

    def of_type(self, kind: str) -> list[Any]:
        return [each for each in self.received if each.get_type() == kind]

    def heartbeat(self) -> None:
        base_mode = 1 | (128 if self.armed else 0)
        self.say(
            mavlink.MAVLink_heartbeat_message(
                self.vehicle_type, self.autopilot, base_mode, self.custom_mode,
                self.system_status, 3,
            )
        )  # fmt: skip

    def _tick(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(0.02, self._tick)
        boot_ms = int(self.boot_s * 1e3) & 0xFFFFFFFF
        if self._ticks % 50 == 0:
            self.heartbeat()
        if self._ticks % 25 == 0:
            health = mavlink.MAV_SYS_STATUS_PREARM_CHECK if self.prearm else 0
            voltage_mv, percent = self.battery
            self.say(
                mavlink.MAVLink_sys_status_message(
                    *[0] * 2, health, 0, voltage_mv, -1, percent, *[0] * 6
                )
            )
            self.say(mavlink.MAVLink_ekf_status_report_message(self.flags, *[0.0] * 5))
            self.say(
                mavlink.MAVLink_estimator_status_message(
                    int(self.boot_s * 1e6), self.flags, *[0.0] * 8
                )
            )
            self.say(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))
            self.say(
                mavlink.MAVLink_home_position_message(
                    1, 1, 488000, *[0.0] * 3, [1, 0, 0, 0], *[0.0] * 3
                )
            )
        self.say(
            mavlink.MAVLink_local_position_ned_message(boot_ms, *self.position_ned_m, *[0.0] * 3)
        )
        if self.says_quaternions:
            self.say(self._quaternion(boot_ms))
        self.say(mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, self.yaw_rad, 0.0, 0.0, 0.0))
        self._ticks += 1

    def _quaternion(self, boot_ms: int) -> Any:
        half_rad = self.yaw_rad / 2.0
        return mavlink.MAVLink_attitude_quaternion_message(
            boot_ms, math.cos(half_rad), 0.0, 0.0, math.sin(half_rad), 0.0, 0.0, 0.0
        )

    def _arrived(self, data: bytes, _: float) -> None:
        if self.muted:
            return
        for message in self.codec.parse(data):
            self.received.append(message)
            kind = message.get_type()
            key = f"{kind}:{message.command}" if kind == "COMMAND_LONG" else kind
            if key in self.replies:
                self.replies[key](self, message)
            elif kind == "COMMAND_LONG":
                self._obey(message)
            elif kind == "TIMESYNC" and message.tc1 == 0:
                self.say(mavlink.MAVLink_timesync_message(int(self.boot_s * 1e9), message.ts1))
            elif kind in {"PARAM_REQUEST_READ", "PARAM_SET"}:
                self._parameter(message)

    def _obey(self, message: Any) -> None:
        self.ack(message)
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE and message.param1 == 148:
            px4 = self.autopilot == mavlink.MAV_AUTOPILOT_PX4
            version = 0x01120080 if px4 else 0x04070000
            self.say(
                mavlink.MAVLink_autopilot_version_message(
                    0, version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 77
                )
            )
        elif message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = message.param1 == 1.0
            self.heartbeat()
        elif message.command == mavlink.MAV_CMD_DO_SET_MODE:
            if self.autopilot == mavlink.MAV_AUTOPILOT_PX4:
                self.custom_mode = int(message.param2) << 16 | int(message.param3) << 24
            else:
                self.custom_mode = int(message.param2)
            self.heartbeat()

    def _parameter(self, message: Any) -> None:
        name = message.param_id
        if name not in self.parameters:
            return
        if message.get_type() == "PARAM_SET":
            self.parameters[name] = (message.param_value, message.param_type)
        value, kind = self.parameters[name]
        self.say(mavlink.MAVLink_param_value_message(name.encode(), value, kind, 1, 0))


@pytest.fixture
def fake_pair() -> Callable[..., tuple[Link, FakePeer]]:
    """Returns a maker of (our end of a link, fake peer at the other end)."""

    def make(autopilot: str = "ardupilot", *, latency_s: float = 0.005) -> tuple[Link, FakePeer]:
        ours, theirs = memory_pair(latency_s=latency_s)
        if autopilot == "px4":
            return ours, FakePeer(
                theirs, autopilot=mavlink.MAV_AUTOPILOT_PX4, custom_mode=4 << 16 | 3 << 24
            )
        return ours, FakePeer(theirs, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)

    return make
