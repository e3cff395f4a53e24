"""A digest of all parameters of a vehicle, gathered from its PARAM_VALUEs without waiting."""

import fnmatch
import hashlib
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget
from wil_campaign.vehicles.driver.onboard.parameter_backup import ParameterValue
from wil_campaign.vehicles.driver.onboard.parameters import decode_parameter
from wil_campaign.vehicles.driver.session.session import MavlinkSession

_NO_INDEX = 65535
"""The index of a PARAM_VALUE that was not requested by index, or is of no parameter."""
_MOST_AGAIN = 40
"""How many missing parameters of a list are requested again."""
_DIGITS = 16


class ParameterDigest:
    """Gathers a digest of a vehicle's parameters, and those that tell its frame.

    PX4 computes the digest itself (its pseudo-parameter `_HASH_CHECK`). Of ArduPilot all parameters
    are requested once, when the vehicle is identified: they arrive while it gets ready, and what is
    set meanwhile is noted from its replies. `settle` says that the configuration which flies is on
    board; the digest is of the values from then on, as soon as all have arrived.
    """

    def __init__(self, *, session: MavlinkSession) -> None:
        self._session = session
        self._autopilot: Autopilot | None = None
        self._target = MavlinkTarget(0)
        self._values: dict[str, ParameterValue] = {}
        self._indexes: set[int] = set()
        self._count: int | None = None
        self._settled = False
        self._digest = ""
        session.on(mavlink.MAVLINK_MSG_ID_PARAM_VALUE, self._on_value)

    @property
    def text(self) -> str:
        """Return the digest in hexadecimal digits; empty while it is unknown."""
        return self._digest

    @property
    def frame(self) -> str:
        """Return the parameters that tell the vehicle's frame, as text; those that are known."""
        names = () if self._autopilot is None else self._autopilot.frame_parameters
        known = [f"{name} {self._values[name]:g}" for name in names if name in self._values]
        return ", ".join(known)

    def begin(self, autopilot: Autopilot, target: MavlinkTarget) -> None:
        """Begin to gather: the vehicle is identified."""
        self._autopilot, self._target = autopilot, target
        if autopilot.parameters_digest is None:
            self._session.send(
                mavlink.MAVLink_param_request_list_message(target.system, target.component)
            )

    def settle(self) -> None:
        """Take the parameters as those that fly, from now on; request what is missing."""
        autopilot = self._autopilot
        if autopilot is None or self._digest:
            return
        self._settled = True
        if autopilot.parameters_digest is None:
            self._finish()
        for name in self._missing_names(autopilot):
            self._request(name.encode(), -1)
        for index in self._missing_indexes():
            self._request(b"", index)

    def _missing_names(self, autopilot: Autopilot) -> Sequence[str]:
        if autopilot.parameters_digest is None:
            return ()
        names = (*autopilot.frame_parameters, autopilot.parameters_digest)
        return [name for name in names if name not in self._values]

    def _missing_indexes(self) -> Sequence[int]:
        missing = sorted(set(range(self._count or 0)) - self._indexes)
        is_list = self._autopilot is not None and self._autopilot.parameters_digest is None
        return missing if is_list and len(missing) <= _MOST_AGAIN else ()

    def _request(self, name: bytes, index: int) -> None:
        target = self._target
        self._session.send(
            mavlink.MAVLink_param_request_read_message(target.system, target.component, name, index)
        )

    def _on_value(self, message: Any, _t_s: float) -> None:
        autopilot = self._autopilot
        if autopilot is None or self._digest:
            return
        name = str(message.param_id)
        value = decode_parameter(
            message.param_value, message.param_type, bytewise=autopilot.parameters_bytewise
        )
        if name == autopilot.parameters_digest:
            if self._settled:
                self._digest = f"{int(value) & 0xFFFFFFFF:08x}"
            return
        self._values[name] = value
        if autopilot.parameters_digest is None:
            self._count = message.param_count
            if message.param_index != _NO_INDEX:
                self._indexes.add(message.param_index)
            if self._settled:
                self._finish()

    def _finish(self) -> None:
        """Make the digest of a list, once it is complete."""
        autopilot = self._autopilot
        if autopilot is None or self._count is None or len(self._indexes) < self._count:
            return
        restless = autopilot.restless_parameters
        lines = [
            f"{name}={value!r}\n"
            for name, value in sorted(self._values.items())
            if not any(fnmatch.fnmatchcase(name, pattern) for pattern in restless)
        ]
        self._digest = hashlib.sha256("".join(lines).encode()).hexdigest()[:_DIGITS]
