"""A relay between a vehicle and its guard, in virtual time: it alters what the vehicle says."""

import asyncio
import struct
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, MavlinkFrame, frame_with_payload

LOCAL_POSITION_NED: int = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
ESTIMATOR_REPORTS: tuple[int, ...] = (
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
)
_FLAGS_AT = dict(zip(ESTIMATOR_REPORTS, (40, 20), strict=True))
"""Where in their payloads the flags are, a uint16."""
_HORIZONTAL = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS
_LAYOUT = struct.Struct("<I6f")

Change = Callable[[MavlinkFrame], Iterable[tuple[float, bytes]]]
"""Returns what goes on in a frame's place: after how many seconds, which bytes."""


@dataclass(frozen=True, slots=True)
class Position:
    """A LOCAL_POSITION_NED: milliseconds since boot, metres and m/s of the vehicle's own frame."""

    boot_ms: int
    values: tuple[float, ...]

    @classmethod
    def of(cls, frame: MavlinkFrame) -> "Position":
        """Return what a frame says."""
        boot_ms, *values = _LAYOUT.unpack(frame.payload.ljust(_LAYOUT.size, b"\0"))
        return cls(boot_ms, tuple(values))

    def in_place_of(self, frame: MavlinkFrame) -> bytes:
        """Return a frame of the same sender that says this."""
        return frame_with_payload(frame, _LAYOUT.pack(self.boot_ms, *self.values))


def frozen() -> Change:
    """Return a change that repeats the first position with the stamps of the later ones."""
    first: list[Position] = []

    def change(frame: MavlinkFrame) -> Iterable[tuple[float, bytes]]:
        now = Position.of(frame)
        first.append(now)
        yield 0.0, Position(now.boot_ms, first[0].values).in_place_of(frame)

    return change


def stopped() -> Change:
    """Return a change that lets nothing pass."""
    return lambda _: ()


def relay(
    vehicle: str,
    change: Change,
    *,
    stage: Stage,
    after_s: float = 0.0,
    message_ids: Collection[int] | None = (LOCAL_POSITION_NED,),
) -> Callable[[VehiclePair, RunState], None]:
    """Return a disturbance: from a stage on, messages go on as `change` says.

    message_ids: of which kinds; None for all.
    """

    def disturb(pair: VehiclePair, run_state: RunState) -> None:
        far: Any = pair.vehicles[vehicle]
        near = far._link._other
        pass_on, splitter = near._take, FrameSplitter()

        def take(data: bytes) -> None:
            loop = asyncio.get_running_loop()
            since_s = run_state.entered_s.get(stage)
            active = since_s is not None and loop.time() >= since_s + after_s
            for frame in splitter.feed(data):
                altered = message_ids is None or frame.message_id in message_ids
                if not active or not altered:
                    pass_on(frame.raw)
                    continue
                for delay_s, raw in change(frame):
                    if delay_s <= 0.0:
                        pass_on(raw)
                    else:
                        loop.call_later(delay_s, pass_on, raw)

        near._take = take

    return disturb


def lost_position() -> Change:
    """Return a change by which the estimator reports that it has no horizontal position."""

    def change(frame: MavlinkFrame) -> Iterable[tuple[float, bytes]]:
        yield 0.0, without_position(frame)

    return change


def without_position(frame: MavlinkFrame) -> bytes:
    """Return an estimator's report that says that it has no horizontal position."""
    return with_flags(frame, lambda flags: flags & ~_HORIZONTAL)


def with_flags(frame: MavlinkFrame, altered: Callable[[int], int]) -> bytes:
    """Return a frame of an estimator's report with other flags."""
    at = _FLAGS_AT[frame.message_id]
    payload = bytearray(frame.payload.ljust(at + 2, b"\0"))
    (flags,) = struct.unpack_from("<H", payload, at)
    struct.pack_into("<H", payload, at, altered(flags))
    return frame_with_payload(frame, bytes(payload))
