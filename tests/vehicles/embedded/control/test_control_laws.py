"""The control laws by themselves: estimates and targets in, thrusts out."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.ardupilot.copter.copter_core import LAW as COPTER
from wil_campaign.plugins.ardupilot.copter.copter_core import CopterCore
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import (
    ParameterTable,
    load_parameters,
)
from wil_campaign.vehicles.embedded.autopilot.px4.px4_core import Px4Core
from wil_campaign.vehicles.embedded.control.law import PX4, ControlLaw, ControlLawKind
from wil_campaign.vehicles.embedded.control.target import ControlTarget
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.motion_kernel import (
    BODY_NUMBERS,
    ESTIMATE,
    FLOWN,
    LAW,
    NO_LAW,
    WRECKED,
    read_and_estimate_motion,
)
from wil_campaign.worlds.jit import F64

AIRFRAME = Airframe()
STEP_S = 0.004
BOTH = pytest.mark.parametrize("kind", [PX4, COPTER], ids=["px4", "ardupilot"])
finite = st.floats(-100.0, 100.0)


def parameters(kind: ControlLawKind, **overrides: float) -> ParameterTable:
    core: Any = Px4Core if kind is PX4 else CopterCore
    firmware = core.firmware
    return load_parameters(firmware.parameter_file, bytewise=firmware.bytewise, overrides=overrides)


def defaults_of(kind: ControlLawKind, table: ParameterTable) -> dict[str, float]:
    """Return the defaults of a law's gains."""
    return {name: table[name] for name in kind.gains}


def new_law(kind: ControlLawKind, **overrides: float) -> ControlLaw:
    law = ControlLaw(
        kind=kind, airframe=AIRFRAME, dt_s=STEP_S, parameters=parameters(kind, **overrides)
    )
    law.reset(yaw_rad=0.0)
    return law


def motion(**values: tuple[float, float, float]) -> F64:
    """Return a motion array at rest, but for the named vectors."""
    array = np.zeros(15)
    array[14] = -9.80665
    for name, value in values.items():
        first = 3 * ("position", "velocity", "euler", "rates", "force").index(name)
        array[first : first + 3] = value
    return array


@BOTH
@given(
    position=st.tuples(finite, finite, finite),
    velocity=st.tuples(finite, finite, finite),
    yaw_rad=st.floats(-3.0, 3.0),
    direct=st.booleans(),
)
def test_thrusts_stay_within_the_motors(
    kind: ControlLawKind,
    position: tuple[float, float, float],
    velocity: tuple[float, float, float],
    yaw_rad: float,
    direct: bool,
) -> None:
    law, now = new_law(kind), motion(velocity=velocity)
    for _ in range(20):
        thrusts = law.run(now, ControlTarget(position, yaw_rad=yaw_rad, direct=direct))
        assert all(0.0 <= thrust <= AIRFRAME.max_thrust_n + 1e-9 for thrust in thrusts)


@BOTH
def test_at_its_place_it_carries_its_weight(kind: ControlLawKind) -> None:
    law, now = new_law(kind), motion()
    for _ in range(250):
        thrusts = law.run(now, ControlTarget((0.0, 0.0, 0.0), yaw_rad=0.0, direct=True))
    assert thrusts == pytest.approx([AIRFRAME.hover_thrust_n] * 4, rel=1e-6)


@BOTH
@pytest.mark.parametrize(
    ("target", "rear_less_front"),
    [
        (ControlTarget((None, None, None), (1.0, 0.0, 0.0), 0.0, direct=True), 1),
        (ControlTarget((None, None, None), (-1.0, 0.0, 0.0), 0.0, direct=True), -1),
    ],
)
def test_it_pitches_towards_where_it_shall_fly(
    kind: ControlLawKind, target: ControlTarget, rear_less_front: int
) -> None:
    law, now = new_law(kind), motion()
    for _ in range(25):
        front_right, rear_left, front_left, rear_right = law.run(now, target)
    assert (rear_left + rear_right - front_left - front_right) * rear_less_front > 0.0


@BOTH
def test_it_turns_the_shorter_way(kind: ControlLawKind) -> None:
    law, now = new_law(kind), motion(euler=(0.0, 0.0, 3.0))
    law.reset(yaw_rad=3.0)
    for _ in range(25):
        # Front right and rear left turn the body clockwise by their reaction.
        one, two, other, last = law.run(now, ControlTarget((0, 0, 0), yaw_rad=-3.0, direct=True))
    assert one + two > other + last


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [(PX4, name, 0.5) for name in PX4.gains if name not in {"MPC_Z_VEL_D_ACC", "MC_YAWRATE_D"}]
    + [(COPTER, name, 0.5) for name in COPTER.gains if name != "ATC_RAT_YAW_D"]
    + [(PX4, "MPC_Z_VEL_D_ACC", 0.5), (PX4, "MC_YAWRATE_D", 0.5), (COPTER, "ATC_RAT_YAW_D", 0.5)],
)
def test_every_parameter_of_a_law_acts(kind: ControlLawKind, name: str, value: float) -> None:
    """Each gain changes the thrusts of a rough ride in which every limit is met."""
    # What caps the feed-forward is nothing without one, and there is none by default.
    needs = {"MC_REF_FF": 1.0} if name == "MC_REF_FF_MAX" else {}

    def ride(**overrides: float) -> list[tuple[float, ...]]:
        law, rng = new_law(kind, **(needs | overrides)), np.random.default_rng(1)
        thrusts: list[tuple[float, ...]] = []
        for step in range(600):
            now = motion(
                position=tuple(rng.normal(0.0, 0.3, 3)),
                velocity=tuple(rng.normal(0.0, 1.0, 3)),
                euler=tuple(rng.normal(0.0, 0.3, 3)),
                rates=tuple(rng.normal(0.0, 0.3, 3)),
                force=(0.0, 0.0, -9.8 + rng.normal()),
            )
            direct = step < 300
            place = (9.0, -9.0, -5.0) if step % 200 < 100 else (None, None, None)
            yaw_rad = 2.0 if step % 150 < 75 else -2.0
            thrusts.append(
                law.run(
                    now, ControlTarget(place, (1.0, 2.0, -1.0), yaw_rad, 0.0, (9, 3, 2), direct)
                )
            )
        return thrusts

    assert ride(**{name: value}) != ride()


@BOTH
@pytest.mark.parametrize("value", [0.0, -1.0, 1e-30, 1e30, 3.4e38, math.nan, math.inf])
def test_thrusts_stay_numbers_whatever_a_parameter_is_set_to(
    kind: ControlLawKind, value: float
) -> None:
    """A client may set a gain to anything that a float can be; the vehicle goes on."""
    law, defaults = new_law(kind), defaults_of(kind, parameters(kind))
    for name in kind.gains:
        law.reset(yaw_rad=0.0)
        law.configure({**defaults, name: value})
        for step in range(200):
            sign = 1.0 if step % 20 < 10 else -1.0
            now = motion(velocity=(sign, 2.0 * sign, -sign), euler=(0.3 * sign, -0.3, sign))
            place = (9.0, -9.0, -5.0) if step % 100 < 50 else (None, None, None)
            target = ControlTarget(place, (1.0, 2.0, -1.0), 2.0 * sign, direct=step < 100)
            thrusts = law.run(now, target)
            assert all(0.0 <= thrust <= AIRFRAME.max_thrust_n + 1e-9 for thrust in thrusts), name


@BOTH
def test_a_velocity_is_cut_to_the_limit_not_turned_aside(kind: ControlLawKind) -> None:
    fast, limited = new_law(kind), new_law(kind)
    asked = ControlTarget(
        (None, None, None), (8.0, -6.0, 0.0), 0.0, speed_m_s=(5.0, 3.0, 1.5), direct=True
    )
    same = asked._replace(velocity_ned_m_s=(4.0, -3.0, 0.0))
    for _ in range(100):
        thrusts = fast.run(motion(), asked)
        assert thrusts == pytest.approx(limited.run(motion(), same), abs=1e-9)


def test_a_parameter_that_is_set_acts_at_once() -> None:
    law = new_law(PX4)
    target = ControlTarget((None, None, None), (1.0, 0.0, 0.0), 0.0, direct=True)
    other = new_law(PX4)
    other.configure(parameters(PX4, MPC_XY_VEL_P_ACC=4.0))
    assert law.run(motion(), target) != other.run(motion(), target)


def test_px4s_attitude_reference_takes_a_step_critically_damped() -> None:
    law = new_law(PX4, MPC_XY_VEL_I_ACC=0.0, MC_REF_W_N=20.0)
    law.run(motion(), ControlTarget((None, None, None), (0.0, 0.0, 0.0), 0.0, direct=True))
    asked_rad = -math.atan(1.8 / 9.80665)
    for step in range(1, 100):
        law.run(motion(), ControlTarget((None, None, None), (1.0, 0.0, 0.0), 0.0, direct=True))
        # The position part runs every second step: the setpoint jumps at the second one here.
        x = 20.0 * STEP_S * (step - 1)
        w, _, y, _ = law._state[36:40]
        assert 2.0 * math.atan2(y, w) == pytest.approx(
            asked_rad * (1.0 - (1.0 + x) * math.exp(-x)), abs=1e-6
        )


def test_px4_integrates_less_by_what_thrust_did_not_produce() -> None:
    """Climbing too fast it throttles down: tilted as asked, it is pushed less than asked."""
    level, climbing = new_law(PX4), new_law(PX4)
    target = ControlTarget((None, None, None), (1.0, 0.0, 0.0), 0.0, direct=True)
    level.run(motion(), target)
    climbing.run(motion(velocity=(0.0, 0.0, -0.5)), target)
    # MPC_XY_VEL_I_ACC 0.4, MPC_XY_VEL_P_ACC 1.8, MPC_Z_VEL_P_ACC 4.0; one step of 8 ms.
    missing_m_s2 = 1.8 * (4.0 * 0.5 / 9.80665)
    assert level._state[10] == pytest.approx(0.4 * 0.008)
    assert climbing._state[10] == pytest.approx(0.4 * (1.0 - 2.0 / 1.8 * missing_m_s2) * 0.008)


def test_px4_does_not_integrate_a_turn_that_the_motors_do_not_give() -> None:
    law = new_law(PX4, MC_YAWRATE_P=1.0)
    integral = []
    for _ in range(250):
        thrusts = law.run(motion(), ControlTarget((0.0, 0.0, 0.0), yaw_rad=2.0, direct=True))
        integral.append(float(law._state[24]))
    assert min(thrusts) == pytest.approx(0.0, abs=1e-9)
    assert integral[-1] == integral[100] > 0.0


def test_arducopter_never_exceeds_its_acceleration_and_jerk() -> None:
    law = new_law(COPTER)
    target = ControlTarget((8.0, 6.0, None), (0.0, 0.0, 0.0), 0.0, speed_m_s=(3.0, 1.0, 1.0))
    states = []
    for _ in range(2500):
        law.run(motion(), target)
        states.append(law._state[:9].copy())
    shape = np.array(states[::2])
    assert np.hypot(shape[:, 3], shape[:, 4]).max() <= 3.0 + 1e-3
    assert np.hypot(shape[:, 6], shape[:, 7]).max() <= 2.5 + 1e-9
    jerk = np.diff(shape[:, 6:8], axis=0) / (2 * STEP_S)
    assert np.hypot(jerk[:, 0], jerk[:, 1]).max() <= 5.0 + 1e-6
    assert shape[-1, :2] == pytest.approx((8.0, 6.0), abs=0.01)


def test_a_slower_motor_is_tuned_to_less_authority() -> None:
    assert PX4.authority(0.05)[0] == pytest.approx(113.1, rel=0.01)
    assert PX4.authority(0.1)[0] == pytest.approx(113.1 / 2.0, rel=0.01)
    assert COPTER.authority(0.008)[0] == 500.0
    assert math.isclose(COPTER.authority(0.06)[2], 40.0)


@pytest.mark.parametrize("tilt_deg", [120.0, 491.0, 21196.0])
@pytest.mark.parametrize(
    ("kind", "name", "most_deg"), [(PX4, "MPC_TILTMAX_AIR", 89.0), (COPTER, "ATC_ANGLE_MAX", 80.0)]
)
def test_a_tilt_of_a_right_angle_or_more_is_the_largest_there_is(
    kind: ControlLawKind, name: str, most_deg: float, tilt_deg: float
) -> None:
    now = motion(position=(30.0, 2.0, -1.0), velocity=(1.0, -0.5, 0.2), euler=(0.2, -0.1, 0.4))
    laws = [new_law(kind, **{name: value}) for value in (tilt_deg, most_deg)]
    for _ in range(500):
        given, most = (law.run(now, ControlTarget((0.0, 0.0, -3.0), yaw_rad=1.0)) for law in laws)
        assert np.isfinite(given).all()
        assert given == most


@BOTH
def test_a_law_that_the_body_runs_gives_the_same_thrusts(kind: ControlLawKind) -> None:
    bodies, late = np.zeros((2, BODY_NUMBERS)), np.zeros((2, 4, 6))
    by_body, alone = (
        ControlLaw(
            kind=kind,
            airframe=AIRFRAME,
            dt_s=STEP_S,
            parameters=parameters(kind),
            array=body[LAW],
        )
        for body in bodies
    )
    target = ControlTarget((1.0, -2.0, -3.0), yaw_rad=0.5, direct=True)
    rng, ran = np.random.default_rng(1), 0
    for number in range(50):
        bodies[:, :15] = rng.standard_normal(15)
        outer = by_body.outer_steps(target)
        bits = kind.advance(bodies[0], late[0], number, outer)
        read_and_estimate_motion(bodies[1], late[1], number, NO_LAW)
        flown = bits & FLOWN != 0
        ran += flown
        assert flown == (outer != NO_LAW and not bits & WRECKED)
        thrusts = by_body.run(bodies[0, ESTIMATE], target, flown=flown)
        assert thrusts == alone.run(bodies[1, ESTIMATE], target)
        assert (bodies[0] == bodies[1]).all()
    assert ran > 20


@BOTH
def test_a_body_that_lies_wrecked_runs_no_law(kind: ControlLawKind) -> None:
    body, late = np.zeros(BODY_NUMBERS), np.zeros((1, 6))
    body[6] = math.pi  # upside down on the ground
    assert kind.advance(body, late, 0, 0) & (WRECKED | FLOWN) == WRECKED
    body[0] = math.nan
    assert kind.advance(body, late, 0, 0) == 0
    assert not body[LAW].any()
