"""How far vehicles fly on when the guard stops them, beside what its geofence predicts.

`python bench/stopping.py [px4|ardupilot ...] [--profile NAME]`; virtual time. An embedded vehicle
in hover is commanded a velocity; in its acceleration, or at a steady speed, the guard's first step
follows: its hold mode, with setpoints of zero until it holds. The path is counted from the place of
the stop command to the farthest one along the velocity commanded. Predicted is the longest path of
`velocities_ahead`, from the same speeds, accelerations and setpoints that the guard has; beside it
that of the present speed alone.
"""

import argparse
import asyncio
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.vehicles.embedded.fidelity.step_flight import PROFILES
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.step_response.flight import SETPOINT_HZ, StepFlight
from wil_campaign.plugins.step_response.segments import HEIGHT_M
from wil_campaign.safety.fence.stopping import (
    AccelerationEstimate,
    VehicleMotion,
    stopping_path,
    velocities_ahead,
)
from wil_campaign.safety.guard.core.events import GuardSettings
from wil_campaign.safety.guard.core.velocity_command import VelocityCommand
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.setpoints import PositionSetpoint, VelocitySetpoint
from wil_campaign.worlds.frames import norm

SPEEDS_M_S = (0.85, 1.5, 2.5, 3.5, 5.0)
AFTER_S = (0.2, 0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 3.0, 5.0)
STILL = VelocitySetpoint((0.0, 0.0, 0.0), yaw_rad=0.0)
START = PositionSetpoint((0.0, 0.0, -HEIGHT_M), 0.0)
SETTINGS = GuardSettings()


class Stops:
    """A vehicle in hover at its start, looking north, that is stopped again and again."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self._acceleration = AccelerationEstimate()
        self._command = VelocityCommand()
        self._motion = VehicleMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        self._farthest_m = 0.0
        driver.on_estimate(self._take)

    def _take(self, sample: EstimateSample) -> None:
        now_s, velocity = asyncio.get_running_loop().time(), sample.velocity_ned_m_s
        acceleration = self._acceleration.update(velocity, now_s)
        place = sample.pose.position_ned_m
        self._motion = VehicleMotion(place, velocity, acceleration, self._command.velocity(now_s))
        self._farthest_m = max(self._farthest_m, place[0])

    async def _send(self, setpoint: VelocitySetpoint | PositionSetpoint, seconds: float) -> None:
        for _ in range(round(seconds * SETPOINT_HZ)):
            self._driver.send(setpoint)
            self._command.note(setpoint, self._motion, asyncio.get_running_loop().time())
            await asyncio.sleep(1.0 / SETPOINT_HZ)

    async def stop_at(self, speed_m_s: float, after_s: float) -> bool:
        """Print how far it flew on; return whether that is longer than predicted."""
        await self._send(VelocitySetpoint((speed_m_s, 0.0, 0.0), yaw_rad=0.0), after_s)
        motion, name = self._motion, self._driver.name
        self._farthest_m = motion.position_ned_m[0]
        self._driver.send(STILL)
        await self._driver.hold()
        await asyncio.sleep(6.0)
        path_m = self._farthest_m - motion.position_ned_m[0]
        lengths = _predicted_m(motion)
        short = "  <-- short" if path_m > max(lengths) else ""
        print(
            f"{name:9s} {speed_m_s:4.2f} m/s for {after_s:3.1f} s: at "
            f"{norm(motion.velocity_ned_m_s):4.2f} m/s, path {path_m:4.2f} m, by speed "
            f"{lengths[0]:4.2f} m, predicted {max(lengths):5.2f} m{short}",
            flush=True,
        )
        return bool(short)

    async def go_back(self) -> None:
        """Fly back to the start and stand still there."""
        await self._send(START, 0.2)
        await self._driver.enter_guided()
        while True:
            await self._send(START, 6.0)
            motion = self._motion
            if abs(motion.position_ned_m[0]) + norm(motion.velocity_ned_m_s) < 0.2:
                return


def _predicted_m(motion: VehicleMotion) -> list[float]:
    """Return the lengths of the predicted paths, the one by the present speed first."""
    late_s, braking = SETTINGS.latency_s, SETTINGS.braking_m_s2
    ahead = velocities_ahead(motion, latency_s=late_s, braking_m_s2=braking)
    return [
        stopping_path(motion, then, latency_s=late_s, braking_m_s2=braking).length_m
        for then in ahead
    ]


async def fly(autopilot: str, profile: str | None) -> int:
    """Return how many paths were longer than predicted."""
    near, far = memory_pair(latency_s=0.003)
    config = EmbeddedConfig(
        autopilot=autopilot, profile=load_profile(profile or PROFILES[autopilot])
    )
    driver = Driver(name=autopilot, link=far, max_clock_drift=0.02)
    async with EmbeddedVehicle(config=config, link=near, seed=1), driver:
        await driver.identify(10.0)
        await StepFlight(driver).take_off()
        stops, short = Stops(driver), 0
        for speed_m_s in SPEEDS_M_S:
            for after_s in AFTER_S:
                await stops.go_back()
                short += await stops.stop_at(speed_m_s, after_s)
        return short


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
