"""The script of the reference traces, flown against any vehicle on a link; keeps all frames."""

import asyncio
import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

NAN = math.nan
NORTH_2_M_S, STILL = (2.0, 0.0, 0.0), (0.0, 0.0, 0.0)


class Script:
    """A small ground station: sends commands, waits for what it sees."""

    def __init__(self, *, link: Link, component: int) -> None:
        self.frames: list[tuple[float, bytes]] = []
        self.last: dict[str, Any] = {}
        self._codec = MavlinkCodec(system_id=250, component_id=component)
        self._heard = asyncio.Event()
        self._link = link
        link.receive(self._on_bytes)

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        self.frames.append((t_s, data))
        for message in self._codec.parse(data):
            self.last[message.get_type()] = message
        self._heard.set()

    def send(self, message: Any) -> None:
        frame = self._codec.pack(message)
        self.frames.append((asyncio.get_running_loop().time(), frame))
        self._link.write(frame)

    def command(self, number: int, *params: float) -> None:
        values = [*params, *(0.0,) * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))

    def velocity(self, velocity: tuple[float, float, float]) -> None:
        boot_ms = self.last["ATTITUDE"].time_boot_ms
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                boot_ms, 1, 1, 1, 3527, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
            )
        )

    async def until(self, ready: Callable[[], bool], *, limit_s: float = 60.0) -> None:
        async with asyncio.timeout(limit_s):
            while not ready():
                self._heard.clear()
                await self._heard.wait()

    async def stream(
        self, velocity: tuple[float, float, float], *, seconds: float, hz: float = 10.0
    ) -> None:
        for _ in range(round(seconds * hz)):
            self.velocity(velocity)
            await asyncio.sleep(1.0 / hz)

    def acked(self, command: int) -> bool:
        ack = self.last.get("COMMAND_ACK")
        return ack is not None and ack.command == command

    def prearm(self) -> bool:
        status = self.last.get("SYS_STATUS")
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        return status is not None and bool(status.onboard_control_sensors_health & bit)

    def armed(self) -> bool:
        return bool(self.last["HEARTBEAT"].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    def height_m(self) -> float:
        return -float(self.last["LOCAL_POSITION_NED"].z)

    def intervals(self, hz_by_id: dict[int, float]) -> None:
        for message_id, hz in hz_by_id.items():
            self.command(511, message_id, 1e6 / hz)
        self.command(512, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)


async def fly_copter(link: Link) -> list[tuple[float, bytes]]:
    """Fly the ArduCopter script; return the frames of both directions with their times."""
    script = Script(link=link, component=190)
    async with link:
        await script.until(lambda: "HEARTBEAT" in script.last)
        script.intervals({1: 2, 24: 5, 32: 20, 33: 10, 30: 20, 193: 5, 245: 5, 2: 1})
        await script.until(lambda: script.prearm() and "LOCAL_POSITION_NED" in script.last)
        script.command(176, 1, 4)
        await script.until(lambda: script.acked(176))
        script.command(400, 1)
        await script.until(lambda: script.acked(400))
        script.command(22, 0, 0, 0, 0, 0, 0, 5)
        await script.until(lambda: script.height_m() > 4.75)
        await script.stream(NORTH_2_M_S, seconds=5.0)
        await asyncio.sleep(5.0)
        script.command(176, 1, 9)
        await script.until(lambda: not script.armed())
    return script.frames


async def fly_px4(link: Link) -> list[tuple[float, bytes]]:
    """Fly the PX4 script; return the frames of both directions with their times."""
    script = Script(link=link, component=191)

    async def heartbeats() -> None:
        while True:
            script.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            await asyncio.sleep(0.5)

    async with link:
        beating = asyncio.create_task(heartbeats())
        await script.until(lambda: "HEARTBEAT" in script.last)
        script.intervals({32: 20, 33: 10, 30: 20, 245: 5})
        await script.until(script.prearm)
        script.send(mavlink.MAVLink_param_set_message(1, 1, b"MIS_TAKEOFF_ALT", 5.0, 9))
        script.command(22, *(NAN,) * 7)
        await script.until(lambda: script.acked(22))
        script.command(400, 1)
        await script.until(lambda: script.height_m() > 4.75)
        await script.stream(STILL, seconds=1.5)
        script.command(176, 1, 6)
        await script.stream(STILL, seconds=1.0)
        await script.stream(NORTH_2_M_S, seconds=5.0)
        await asyncio.sleep(4.0)
        script.command(176, 1, 4, 6)
        await script.until(lambda: not script.armed())
        beating.cancel()
    return script.frames
