"""A ground station at the guard's port that sends more than it should, in virtual time."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.missions import AutopilotKind
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget, command_long
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import FrameSplitter

_STATION = 255
_AGAIN_S = 0.2
_PARAMETERS: Mapping[AutopilotKind, tuple[str, ...]] = {
    "px4": ("GF_ACTION", "NAV_DLL_ACT", "COM_OBL_RC_ACT", "COM_LOW_BAT_ACT"),
    "ardupilot": ("FENCE_ENABLE", "FENCE_ACTION", "FS_GCS_ENABLE", "FS_THR_ENABLE"),
}
TAKES_OVER = ("sticks", "mode", "setpoints")
"""What reaches a vehicle: then the flight is no test any more."""
SENDS = ("parameters", "mission", "estimate", "commands", *TAKES_OVER)


def messages(what: str, system: int, autopilot: AutopilotKind) -> Sequence[Any]:
    """Return what a ground station sends again and again. what: one of SENDS."""
    command = MavlinkTarget(system)
    sent: Mapping[str, Sequence[Any]] = {
        "parameters": [
            *(
                mavlink.MAVLink_param_set_message(system, 1, name.encode(), 0.0, 6)
                for name in _PARAMETERS[autopilot]
            ),
            mavlink.MAVLink_param_ext_set_message(system, 1, b"CAM_MODE", b"1", 1),
        ],
        "mission": [
            *(mavlink.MAVLink_mission_clear_all_message(system, 1, kind) for kind in (0, 1)),
            mavlink.MAVLink_mission_count_message(system, 1, 4, 1),
        ],
        "estimate": [
            mavlink.MAVLink_vision_position_estimate_message(0, 5.0, *[0.0] * 5),
            mavlink.MAVLink_att_pos_mocap_message(0, [1.0, 0.0, 0.0, 0.0], 5.0, 0.0, 0.0),
            mavlink.MAVLink_set_gps_global_origin_message(system, 1, 2, 3),
        ],
        "commands": [
            command_long(command, mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 9),
            command_long(command, mavlink.MAV_CMD_DO_SET_HOME, 1),
            command_long(command, mavlink.MAV_CMD_DO_FENCE_ENABLE, 0),
        ],
        "sticks": [
            mavlink.MAVLink_manual_control_message(system, 500, 0, 500, 0, 0),
            mavlink.MAVLink_rc_channels_override_message(system, 1, *[1500] * 8),
        ],
        "mode": [command_long(command, mavlink.MAV_CMD_NAV_LAND)],
        "setpoints": [
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, system, 1, 1, 0b110111000111, *[0.0] * 3, 1.0, *[0.0] * 7
            )
        ],
    }
    return sent[what]


@dataclass(slots=True)
class GroundStation:
    """Sends from a moment on. arrived: the ids of its messages that reached the vehicle."""

    vehicle: str
    what: str
    autopilot: AutopilotKind
    is_active: Callable[[], bool]
    arrived: set[int] = field(default_factory=set)
    sent: int = 0
    _pair: VehiclePair | None = None
    _codec: MavlinkCodec = field(
        default_factory=lambda: MavlinkCodec(system_id=_STATION, component_id=190)
    )

    def disturb(self, pair: VehiclePair, _: RunState) -> None:
        """Begin to send, and to look at what arrives."""
        self._pair = pair
        far: Any = pair.vehicles[self.vehicle]
        link, splitter = far._link, FrameSplitter()
        pass_on = link._take

        def take(data: bytes) -> None:
            own = [one for one in splitter.feed(data) if one.system == _STATION]
            self.arrived.update(one.message_id for one in own)
            pass_on(data)

        link._take = take
        self._send()

    @property
    def events(self) -> list[GuardEvent]:
        """Return the guard's events that name it."""
        own = f"the ground station {_STATION}/190"
        guard: Any = None if self._pair is None else self._pair.guard
        return [] if guard is None else [event for event in guard.events if own in event.text]

    def _send(self) -> None:
        loop = asyncio.get_running_loop()
        if self.is_active() and self._pair is not None:
            far: Any = self._pair.vehicles[self.vehicle]
            guard: Any = self._pair.guard
            for message in messages(self.what, far.config.system_id, self.autopilot):
                self.sent += 1
                now_s, raw = loop.time(), self._codec.pack(message)
                guard._apply(guard.core.from_gcs(self.vehicle, raw, now_s), now_s)
        loop.call_later(_AGAIN_S, self._send)
