"""The compiled body is held to JSBSim: equal commands, and how far the two come apart."""

import math

import pytest

from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.compiled_plant import CompiledPlant
from wil_campaign.vehicles.embedded.physics.plant import JsbsimPlant, Plant
from wil_campaign.vehicles.poses.truth import STOPPED, Thrusts

PAPER = Airframe()
HEAVY = Airframe(
    mass_kg=1.0,
    inertia_xx_kg_m2=0.025,
    inertia_yy_kg_m2=0.02,
    inertia_zz_kg_m2=0.03,
    arm_m=0.28,
    max_thrust_n=5.0,
    linear_drag_n_s_m=0.3,
)
PLACES = {"Zurich": (47.4, 488.0), "Quito": (-0.2, 2850.0)}
FARTHEST_M, FASTEST_M_S, TURNED_RAD, TURNING_RAD_S = 0.005, 0.003, 2e-4, 2e-4
"""What the two may be apart after 4 s of a flight that nothing steers, at 1 to 6 m/s."""


def pair(airframe: Airframe = PAPER, place: str = "Zurich", *, spread: float = 0.0) -> list[Plant]:
    latitude_deg, altitude_m = PLACES[place]
    return [
        kind(
            airframe=airframe,
            motor_lag_s=0.05,
            motor_factors=(1.0 + spread, 1.0, 1.0 - spread, 1.0),
            latitude_deg=latitude_deg,
            longitude_deg=8.5,
            altitude_m=altitude_m,
            yaw_rad=-2.5,
            rate_hz=250,
        )
        for kind in (JsbsimPlant, CompiledPlant)
    ]


def both(plants: list[Plant], thrusts: Thrusts, steps: int = 1) -> None:
    for plant in plants:
        for _ in range(steps):
            plant.step(thrusts)


def apart(plants: list[Plant]) -> list[float]:
    """Return by how much position, velocity, angles, rates and specific force differ at most."""
    one, other = (plant.motion() for plant in plants)
    return [math.dist(a, b) for a, b in zip(one, other, strict=True)]


@pytest.mark.parametrize("airframe", [PAPER, HEAVY])
@pytest.mark.parametrize("place", list(PLACES))
def test_it_flies_as_jsbsim_does(airframe: Airframe, place: str) -> None:
    plants, h = pair(airframe, place), airframe.hover_thrust_n
    both(plants, (1.3 * h,) * 4, 250)
    for plant in plants:
        plant.set_wind((2.0, -1.0, 0.3))
    for i in range(750):
        a, b = 0.002 * math.sin(i / 20), 0.002 * math.cos(i / 35)
        both(plants, (h * (1 + a), h * (1 + b), h * (1 - a), h * (1 - b + 0.002)))
    place_m, speed_m_s, turned_rad, turning_rad_s, force_m_s2 = apart(plants)
    assert math.hypot(*plants[0].motion().velocity_ned_m_s) > 1.0
    assert place_m < FARTHEST_M
    assert speed_m_s < FASTEST_M_S
    assert turned_rad < TURNED_RAD
    assert turning_rad_s < TURNING_RAD_S
    assert force_m_s2 < 0.002


def test_it_leaves_the_ground_as_jsbsim_does() -> None:
    plants, h = pair(spread=0.01), PAPER.hover_thrust_n
    both(plants, (0.08 * h,) * 4, 250)
    both(plants, (1.2 * h,) * 4, 60)
    assert not any(plant.on_ground() for plant in plants)
    place_m, speed_m_s, turned_rad, *_ = apart(plants)
    assert place_m < 1e-3
    assert speed_m_s < 1e-3
    assert turned_rad < 1e-3


def test_it_lands_and_rests_as_jsbsim_does() -> None:
    plants, h = pair(), PAPER.hover_thrust_n
    both(plants, (1.2 * h,) * 4, 150)
    both(plants, (0.9 * h,) * 4, 500)
    landed = [plant.motion().position_ned_m for plant in plants]
    assert math.dist(*landed) < 0.002
    both(plants, STOPPED, 250)
    for plant in plants:
        motion = plant.motion()
        assert plant.on_ground()
        assert math.hypot(*motion.velocity_ned_m_s, *motion.rates_rad_s) < 1e-3
        assert abs(motion.position_ned_m[2]) < 1e-3


def test_a_leg_that_slides_stops() -> None:
    """Friction takes the speed away, and never more than that: it does not reverse it."""
    _, plant = pair()
    state = vars(plant)["_state"]
    state[3:6] = state[19:22] = state[22:25] = (1.0, 0.0, 0.0)
    speeds = []
    for _ in range(250):
        plant.step(STOPPED)
        speeds.append(plant.motion().velocity_ned_m_s[0])
    assert min(speeds) > -0.02
    assert speeds[5] > 0.5
    assert abs(speeds[-1]) < 1e-3
