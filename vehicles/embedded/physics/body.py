"""The vehicle's body: physics, wind, battery, estimator and contacts; no MAVLink."""

import math
from collections.abc import Callable

import numpy as np

from wil_campaign.vehicles.embedded.physics.battery import SimulatedBattery
from wil_campaign.vehicles.embedded.physics.compiled_plant import CompiledPlant
from wil_campaign.vehicles.embedded.physics.config import ContactWorld, EmbeddedConfig
from wil_campaign.vehicles.embedded.physics.estimator import EmulatedEstimator
from wil_campaign.vehicles.embedded.physics.motion_kernel import (
    ESTIMATE,
    FLOWN,
    LAW,
    NEAR_GROUND,
    NO_LAW,
    TRUTH,
    WRECKED,
    Advance,
)
from wil_campaign.vehicles.embedded.physics.noise import GaussMarkov
from wil_campaign.vehicles.embedded.physics.plant import JsbsimPlant
from wil_campaign.vehicles.embedded.physics.states import BodyMotion, motion_of_array
from wil_campaign.vehicles.poses.truth import STOPPED, Thrusts, TruthSample
from wil_campaign.worlds.frames import Pose, Vec3, add, quat_from_euler, rotate

PHYSICS_HZ = 250
_AIR_HZ = 25
_CONTACT_HZ = 50
_STILL = 2e-3
"""m/s and rad/s below which a disarmed vehicle on its legs counts as at rest."""


class FlyingBody:
    """The flying body: takes thrusts 250 times a second, returns estimates and truth."""

    def __init__(
        self, *, config: EmbeddedConfig, seed: int, contact_world: ContactWorld | None
    ) -> None:
        profile, airframe = config.profile, config.airframe
        motors_rng, air_rng, estimator_rng = (
            np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)
        )
        spread = (motors_rng.standard_normal(4) * profile.motors.spread).tolist()
        heading = config.start.yaw_rad if config.heading_rad is None else config.heading_rad
        self._start = config.start.position_ned_m
        self._turn_rad = config.start.yaw_rad - heading
        self._turn = quat_from_euler(0.0, 0.0, self._turn_rad)
        plant = JsbsimPlant if config.physics == "jsbsim" else CompiledPlant
        self._plant = plant(
            airframe=airframe,
            motor_lag_s=profile.motors.lag_s,
            motor_factors=(1 + spread[0], 1 + spread[1], 1 + spread[2], 1 + spread[3]),
            latitude_deg=config.latitude_deg,
            longitude_deg=config.longitude_deg,
            altitude_m=config.altitude_m - config.start.position_ned_m[2],
            yaw_rad=heading,
            rate_hz=PHYSICS_HZ,
        )
        self._air = GaussMarkov(
            sigma=profile.air.sigma_m_s,
            time_constant_s=profile.air.time_constant_s,
            dt_s=1.0 / _AIR_HZ,
            rng=air_rng,
        )
        self._still_air = not any(profile.air.sigma_m_s)
        self._mean_wind: Callable[[], Vec3] | None = None
        array = self._plant.array
        self._estimator = EmulatedEstimator(
            noise=profile.estimator, rate_hz=PHYSICS_HZ, rng=estimator_rng, body=array
        )
        self.battery = SimulatedBattery(
            profile=profile.battery, hover_thrust_n=4 * airframe.hover_thrust_n
        )
        self._contact_world = contact_world
        self._last_pose: tuple[Pose, float] | None = None
        self._steps = 0
        self._resting_steps = 0
        self._wrecked = False
        self.estimate, self.law_array = array[ESTIMATE], array[LAW]
        """The estimate's motion array, and the array of the control law that flies the body."""
        self.flown = False
        """Whether the last step has run the law."""
        self._motion = array[TRUTH]
        self._motion[:] = [number for vector in self._plant.motion() for number in vector]
        self._truth: BodyMotion | None = None
        self._pose: Pose | None = None
        self.touching = True
        self.contact: str | None = None
        self.motors_stopped = True

    @property
    def truth(self) -> BodyMotion:
        """Return the true motion, NED with true north, relative to the start."""
        truth = self._truth
        if truth is None:
            truth = self._truth = motion_of_array(self._motion)
        return truth

    def step(self, thrusts: Thrusts, t_s: float, outer: int = NO_LAW) -> None:
        """Advance the body and its estimate one step with these commands.

        outer: with how many outer steps the law is run in the same call, see `flown`.
        """
        if self.contact is not None:
            thrusts = STOPPED
        self.motors_stopped = thrusts == STOPPED
        if not self.motors_stopped:
            self._resting_steps = 0
        self._steps = steps = self._steps + 1
        if steps % (PHYSICS_HZ // _AIR_HZ) == 0:
            self.battery.drain(sum(thrusts), 1.0 / _AIR_HZ)
            self._blow()
        if self.motors_stopped and self._is_resting():
            self._estimator.estimate(self._motion)
            self.flown = False
        else:
            plant = self._plant
            plant.step(thrusts, self.battery.thrust_factor)
            bits = self._estimator.read(outer)
            if not bits:
                raise plant.divergence()
            self._pose = self._truth = None
            self.flown = bits & FLOWN != 0
            self.touching = bits & NEAR_GROUND != 0 and plant.on_ground()
            if bits & WRECKED:
                self._wreck()
        if steps % (PHYSICS_HZ // _CONTACT_HZ) == 0:
            self._check_contact(t_s)

    def flown_by(self, law: Advance) -> None:
        """Run a control law with a step, where the step is asked to."""
        self._estimator.advance_by(law)

    def pose(self) -> Pose:
        """Return the body's true pose in the world's local frame."""
        pose = self._pose
        if pose is None:
            truth = self.truth
            roll, pitch, yaw = truth.euler_rad
            pose = self._pose = Pose(
                add(self._start, self._to_world(truth.position_ned_m)),
                quat_from_euler(roll, pitch, yaw + self._turn_rad),
            )
        return pose

    def sample(self, t_s: float) -> TruthSample:
        """Return the body's true motion as a sample."""
        return TruthSample(
            t_s,
            self.pose(),
            self._to_world(self.truth.velocity_ned_m_s),
            self.touching,
            self.motors_stopped,
            self.contact,
            self.truth.rates_rad_s,
            self.truth.specific_force_m_s2,
            self._plant.thrusts(),
        )

    def blown_by(self, wind_ned_m_s: Callable[[], Vec3]) -> None:
        """Add a wind to the air's own: towards north, east and down; asked 25 times a second."""
        self._mean_wind = wind_ned_m_s
        self._still_air = False

    def fail_motor(self, index: int, *, factor: float = 0.0) -> None:
        """Multiply the thrust of one motor of the body by this factor from now on."""
        self._plant.fail_motor(index, factor=factor)

    def _blow(self) -> None:
        """Set the wind: the profile's gusts, and a mean wind where there is one."""
        if self._still_air:
            return
        north, east, down = self._air.advance()
        if self._mean_wind is not None:
            north, east, down = add((north, east, down), self._mean_wind())
        self._plant.set_wind((north, east, down))

    def _to_world(self, vector: Vec3) -> Vec3:
        return rotate(self._turn, vector) if self._turn_rad else vector

    def _is_resting(self) -> bool:
        """Return whether the body, its motors stopped, rests: on its legs, still for a while.

        The physics of a vehicle at rest is skipped; getting ready may take 40 s.
        """
        if self._wrecked:
            return True
        if not self.touching:
            self._resting_steps = 0
            return False
        if self._resting_steps < PHYSICS_HZ:
            truth = self.truth
            fastest = max(map(math.fabs, truth.velocity_ned_m_s + truth.rates_rad_s))
            self._resting_steps = self._resting_steps + 1 if fastest < _STILL else 0
            return False
        return True

    def _wreck(self) -> None:
        """Leave the body where it lies, with the ground as its contact."""
        self._wrecked = self.touching = self.motors_stopped = True
        self.contact = self.contact or "ground"

    def _check_contact(self, t_s: float) -> None:
        if self._contact_world is None or self.contact is not None:
            return
        pose = self.pose()
        flies = not (self.motors_stopped and self.touching)
        if self._last_pose is not None and flies:
            before, t_before_s = self._last_pose
            self.contact = self._contact_world.contact(before, t_before_s, pose, t_s)
        self._last_pose = (pose, t_s)
