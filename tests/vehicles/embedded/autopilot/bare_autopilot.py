"""An autopilot by itself: no body and no link, messages in, packed messages out, virtual time.

The estimate is what the test says. A hundred times faster than a flown vehicle: for what a
client sends and gets back, not for how the vehicle flies.
"""

from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.physics.body import FlyingBody
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import build_autopilot
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

TURN_S = 0.02
READY_S = {"px4": 7.0, "ardupilot": 42.0}


class BareAutopilot:
    """An emulated autopilot that is sent messages; what it answers has been over the wire."""

    def __init__(self, autopilot: str, **config: Any) -> None:
        settings = EmbeddedConfig(autopilot=autopilot, **config)
        body = FlyingBody(config=settings, seed=1, contact_world=None)
        self.altitude_m = settings.altitude_m
        self.autopilot = build_autopilot(settings, body)
        self.estimate = body.estimate
        self.estimate[14] = -9.80665
        self._body = body
        self.t_s = 0.0
        self._client = MavlinkCodec(system_id=255, component_id=190)
        self._received = MavlinkCodec(system_id=1, component_id=1)
        self._sent = MavlinkCodec(system_id=1, component_id=1)
        self._answers = MavlinkCodec(system_id=255, component_id=190)

    @property
    def height_m(self) -> float:
        return -float(self.estimate[2])

    @height_m.setter
    def height_m(self, height_m: float) -> None:
        self.estimate[2] = -height_m

    def run(self, seconds: float) -> list[Any]:
        """Let time pass in turns of 20 ms; return what was sent."""
        sent: list[Any] = []
        for _ in range(max(1, round(seconds / TURN_S))):
            self.t_s += TURN_S
            self._body.touching = self.height_m < 0.05
            thrusts = self.autopilot.step(self.t_s, turn=True)
            assert np.isfinite(thrusts).all(), thrusts
            sent += self._flush()
        return sent

    def send(self, message: Any, *, system: int = 255) -> list[Any]:
        """Send a message as a client does; return what is answered at once."""
        client = self._client if system == 255 else MavlinkCodec(system_id=system, component_id=190)
        for received in self._received.parse(client.pack(message)):
            self.autopilot.handle(received, self.t_s)
        return self._flush()

    def command(self, number: int, *params: float) -> int:
        """Send a COMMAND_LONG; return the result of its acknowledgement."""
        values = [*params, *(0.0,) * (7 - len(params))]
        answers = self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))
        (ack,) = [each for each in answers if each.get_type() == "COMMAND_ACK"]
        assert ack.command == number
        return int(ack.result)

    def hover(self) -> None:
        """Become ready, arm, take off, and be 3 m high."""
        px4 = self.autopilot.firmware.bytewise
        self.run(READY_S["px4" if px4 else "ardupilot"])
        if not px4:
            assert self.command(176, 1, 4) == 0
        assert self.command(400, 1) == 0
        nan = float("nan")
        place = (nan, nan, nan, self.altitude_m + 3.0) if px4 else (0.0, 0.0, 0.0, 3.0)
        assert self.command(22, nan if px4 else 0.0, 0.0, 0.0, *place) == 0
        self.run(5.0)
        self.height_m = 3.0
        self.run(3.0)
        assert not self.autopilot.flight.landed

    def _flush(self) -> list[Any]:
        packed = [self._sent.pack(message) for message in self.autopilot.outbox.take()]
        return self._answers.parse(b"".join(packed))
