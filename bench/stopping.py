"""How far vehicles fly on when the guard stops them, beside what its geofence predicts.

`python bench/stopping.py [px4|ardupilot ...] [--profile NAME]`; virtual time. An embedded vehicle
in hover is commanded a velocity; in its acceleration, or at a steady speed, the guard's first step
follows: its hold mode, with setpoints of zero until it holds. The path is counted from the place of
the stop command to the farthest one along the velocity commanded. Predicted is the longest path of
`velocities_ahead`, from the same speeds, accelerations and setpoints that the guard has; beside it
that of the present speed alone.
"""

import argparse
import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from orchestrator.model.clock import run_virtual
from safety.fence.stopping import AccelerationEstimate, Motion, stopping_path, velocities_ahead
from safety.guard.core.events import GuardSettings
from safety.guard.core.velocity_command import VelocityCommand
from tests.vehicles.embedded.fidelity.step_flight import (
    PROFILES,
    SETPOINT_HZ,
    VELOCITY,
    Autopilot,
    Sample,
    StepFlight,
)
from vehicles.autopilots.ardupilot import ArduCopter
from vehicles.autopilots.autopilot import Mode, Target
from vehicles.autopilots.px4 import Px4
from vehicles.embedded.physics.config import EmbeddedConfig
from vehicles.embedded.profile import load_profile
from vehicles.embedded.vehicle import EmbeddedVehicle
from vehicles.links.memory import memory_pair
from vehicles.setpoints import VelocitySetpoint
from vehicles.tasks import start, stop
from worlds.frames import Vec3

SPEEDS_M_S = (0.85, 1.5, 2.5, 3.5, 5.0)
AFTER_S = (0.2, 0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 3.0, 5.0)
AUTOPILOTS = {"px4": Px4(), "ardupilot": ArduCopter()}
SETTINGS = GuardSettings()


class StopFlight(StepFlight):
    """A vehicle that is stopped again and again."""

    async def fly_stops(self) -> int:
        """Print a line for each speed and moment; return how many paths were underestimated."""
        beating = start(self._beat(), name="heartbeats")
        try:
            await self._get_ready()
            short = 0
            for speed_m_s in SPEEDS_M_S:
                for after_s in AFTER_S:
                    short += await self._stop_at(speed_m_s, after_s)
                    await self._return()
            return short
        finally:
            await stop(beating)

    async def _stop_at(self, speed_m_s: float, after_s: float) -> bool:
        ahead = (math.cos(self._yaw_rad), math.sin(self._yaw_rad))
        asked = (speed_m_s * ahead[0], speed_m_s * ahead[1], 0.0)
        estimate, command = AccelerationEstimate(), VelocityCommand()
        samples: list[Sample] = []
        motion = Motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for i in range(round(after_s * SETPOINT_HZ)):
            command.note(VelocitySetpoint(asked), motion, i / SETPOINT_HZ)
            new = await self._stream(1.0 / SETPOINT_HZ, lambda: self._move(asked))
            samples = new or samples
            for q in new:
                velocity = (q.vn_m_s, q.ve_m_s, q.vd_m_s)
                acceleration = estimate.update(velocity, q.t_s)
                commanded = command.velocity(i / SETPOINT_HZ)
                motion = Motion((0.0, 0.0, 0.0), velocity, acceleration, commanded)
        autopilot, here = AUTOPILOTS[self._autopilot], samples[-1]
        self._send(autopilot.set_mode(Target(1, 1), Mode.HOLD))
        flown = await self._stream(6.0, lambda: self._move((0.0, 0.0, 0.0)))
        path_m = max(
            (q.north_m - here.north_m) * ahead[0] + (q.east_m - here.east_m) * ahead[1]
            for q in flown
        )
        lengths = [_length_m(motion, then) for then in _ahead(motion)]
        print(
            f"{self._autopilot:9s} {speed_m_s:4.2f} m/s for {after_s:3.1f} s: "
            f"at {math.hypot(here.vn_m_s, here.ve_m_s):4.2f} m/s, path {path_m:4.2f} m, "
            f"by speed {lengths[0]:4.2f} m, predicted {max(lengths):5.2f} m"
            f"{'  <-- short' if path_m > max(lengths) else ''}",
            flush=True,
        )
        return path_m > max(lengths)

    def _move(self, velocity: Vec3) -> None:
        self._setpoint(VELOCITY, velocity=velocity, yaw_rad=self._yaw_rad)

    async def _return(self) -> None:
        while True:
            await self._stream(1.0, self._hold)
            number = AUTOPILOTS[self._autopilot].set_mode(Target(1, 1), Mode.GUIDED)
            self._send(number)
            await self._stream(11.0, self._hold)
            place = self._last["LOCAL_POSITION_NED"]
            if math.dist((place.x, place.y), self._hover[:2]) < 0.2:
                return


def _ahead(motion: Motion) -> list[Vec3]:
    return list(
        velocities_ahead(motion, latency_s=SETTINGS.latency_s, braking_m_s2=SETTINGS.braking_m_s2)
    )


def _length_m(motion: Motion, then: Vec3) -> float:
    return stopping_path(
        motion, then, latency_s=SETTINGS.latency_s, braking_m_s2=SETTINGS.braking_m_s2
    ).length_m


async def fly(autopilot: Autopilot, profile: str | None) -> int:
    near, far = memory_pair(latency_s=0.003)
    config = EmbeddedConfig(
        autopilot=autopilot, profile=load_profile(profile or PROFILES[autopilot])
    )
    flight = StopFlight(far, autopilot)
    async with far, EmbeddedVehicle(config=config, link=near, seed=1):
        return await flight.fly_stops()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("autopilot", nargs="*", default=["px4", "ardupilot"])
    parser.add_argument("--profile", default=None)
    arguments = parser.parse_args()
    for autopilot in arguments.autopilot:
        short = run_virtual(fly(autopilot, arguments.profile))
        print(f"{autopilot}: {short} paths longer than predicted")


if __name__ == "__main__":
    main()
