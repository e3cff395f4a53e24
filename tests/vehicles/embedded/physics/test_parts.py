"""The vehicle's parts by themselves: values in, values out."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from tests.vehicles.embedded.at_rest import AT_REST
from tests.vehicles.embedded.charge import set_remaining
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.vehicles.embedded.physics import plant as plant_module
from wil_campaign.vehicles.embedded.physics.airframe import Airframe, aircraft_root, aircraft_xml
from wil_campaign.vehicles.embedded.physics.battery import SimulatedBattery
from wil_campaign.vehicles.embedded.physics.compiled_plant import CompiledPlant
from wil_campaign.vehicles.embedded.physics.estimator import EmulatedEstimator
from wil_campaign.vehicles.embedded.physics.mocap_feed import NEVER, MotionCaptureFeed
from wil_campaign.vehicles.embedded.physics.motion_kernel import BODY_NUMBERS
from wil_campaign.vehicles.embedded.physics.noise import GaussMarkov
from wil_campaign.vehicles.embedded.physics.plant import JsbsimPlant, Plant, PlantError
from wil_campaign.vehicles.embedded.physics.states import BodyMotion, motion_of_array
from wil_campaign.vehicles.embedded.profile import (
    AirframeNumbers,
    ProfileError,
    list_profiles,
    load_profile,
)
from wil_campaign.vehicles.poses.truth import STOPPED, TruthSample
from wil_campaign.worlds.frames import Pose, angle_between
from wil_campaign.worlds.jit import F64

AIRFRAME = Airframe()
AIRFRAME_NUMBERS = {
    "mass_kg": "2.1",
    "inertia_xx_kg_m2": "0.022",
    "inertia_yy_kg_m2": "0.022",
    "inertia_zz_kg_m2": "0.04",
    "arm_m": "0.225",
    "torque_per_thrust_m": "0.02",
    "max_thrust_n": "10.0",
    "drag_area_m2": "[0.01, 0.01, 0.02]",
    "linear_drag_n_s_m": "0",
    "angular_damping_n_m_s": "0.0006",
}
NOMINAL, CAGE = load_profile("nominal"), load_profile("cage")
HOVER = (AIRFRAME.hover_thrust_n,) * 4
finite = st.floats(-100.0, 100.0)


Kind = type[JsbsimPlant] | type[CompiledPlant]
both = pytest.mark.parametrize("kind", [JsbsimPlant, CompiledPlant])


def plant(
    kind: Kind = JsbsimPlant,
    *,
    yaw_rad: float = 0.0,
    factors: tuple[float, float, float, float] = (1, 1, 1, 1),
) -> Plant:
    return kind(
        airframe=AIRFRAME,
        motor_lag_s=0.05,
        motor_factors=factors,
        latitude_deg=47.4,
        longitude_deg=8.5,
        altitude_m=488.0,
        yaw_rad=yaw_rad,
        rate_hz=250,
    )


# Airframe and physics.


def test_the_aircraft_file_is_xml_with_four_motors_and_legs() -> None:
    root = ET.fromstring(aircraft_xml(AIRFRAME, motor_lag_s=0.05))  # noqa: S314 - our own text
    assert len(root.findall("ground_reactions/contact")) == 4
    assert len(root.findall("external_reactions/force")) == 4
    weight = root.findtext("mass_balance/emptywt")
    assert weight is not None
    assert float(weight) == AIRFRAME.mass_kg


def test_equal_aircraft_share_a_folder_and_a_spoilt_one_is_mended() -> None:
    root = aircraft_root(AIRFRAME, motor_lag_s=0.0512)
    assert aircraft_root(AIRFRAME, motor_lag_s=0.0512) == root
    assert aircraft_root(AIRFRAME, motor_lag_s=0.0513) != root
    file = root / "aircraft" / "quadx" / "quadx.xml"
    file.write_text("half a fi", encoding="utf-8")
    aircraft_root(AIRFRAME, motor_lag_s=0.0512)
    assert file.read_text(encoding="utf-8") == aircraft_xml(AIRFRAME, motor_lag_s=0.0512)


def array_of(motion: BodyMotion) -> F64:
    """Return the motion array of a motion."""
    return np.array([number for vector in motion for number in vector])


def scaled(factor: float) -> tuple[float, float, float, float]:
    """Return a share of the thrusts that hover."""
    a, b, c, d = HOVER
    return (factor * a, factor * b, factor * c, factor * d)


@both
def test_stands_still_with_its_heading(kind: Kind) -> None:
    p = plant(kind, yaw_rad=-2.5)
    for _ in range(500):
        p.step(STOPPED)
    motion = p.motion()
    assert p.on_ground()
    assert motion.position_ned_m == pytest.approx((0, 0, 0), abs=1e-3)
    assert motion.euler_rad == pytest.approx((0, 0, -2.5), abs=1e-3)
    assert motion.specific_force_m_s2 == pytest.approx((0, 0, -9.8), abs=0.05)


@both
def test_hover_thrust_hovers_and_more_climbs(kind: Kind) -> None:
    p = plant(kind)
    for _ in range(250):
        p.step(scaled(1.2))
    north, east, down = p.motion().position_ned_m
    # 0.2 g for a second less the motors' lag.
    assert -1.0 < down < -0.6
    assert (north, east) == pytest.approx((0, 0), abs=0.01)
    assert not p.on_ground()


@both
@pytest.mark.parametrize(
    ("motors", "axis", "sign"),
    [((0, 3), 0, -1), ((1, 2), 0, 1), ((0, 2), 1, 1), ((1, 3), 1, -1), ((0, 1), 2, 1)],
)
def test_each_motor_turns_it_the_right_way(
    kind: Kind, motors: tuple[int, int], axis: int, sign: int
) -> None:
    p = plant(kind)
    thrusts = list(scaled(1.3))
    for _ in range(100):
        p.step((thrusts[0], thrusts[1], thrusts[2], thrusts[3]))
    for motor in motors:
        thrusts[motor] *= 1.1
    for _ in range(25):
        p.step((thrusts[0], thrusts[1], thrusts[2], thrusts[3]))
    assert p.motion().rates_rad_s[axis] * sign > 0.1


@both
def test_wind_carries_it_along(kind: Kind) -> None:
    p = plant(kind)
    for _ in range(100):
        p.step(scaled(1.3))
    p.set_wind((0.0, 3.0, 0.0))
    for _ in range(100):
        p.step(HOVER)
    assert p.motion().velocity_ned_m_s[1] > 0.02
    assert abs(p.motion().velocity_ned_m_s[0]) < 0.005


@both
def test_a_failed_motor_gives_nothing(kind: Kind) -> None:
    p = plant(kind)
    for _ in range(100):
        p.step(scaled(1.3))
    p.fail_motor(0)
    for _ in range(50):
        p.step(HOVER)
    assert max(map(abs, p.motion().rates_rad_s)) > 1.0


@both
def test_a_mended_motor_gives_what_it_gave_before(kind: Kind) -> None:
    p = plant(kind, factors=(0.95, 1.0, 1.0, 1.0))

    def thrust_n() -> float:
        """Return the first motor's thrust at a command of 1 N."""
        for _ in range(250):
            p.step((1.0, 1.0, 1.0, 1.0))
        return p.thrusts()[0]

    assert thrust_n() == pytest.approx(0.95, abs=1e-3)
    p.fail_motor(0, factor=0.5)
    assert thrust_n() == pytest.approx(0.475, abs=1e-3)
    p.fail_motor(0, factor=1.0)
    assert thrust_n() == pytest.approx(0.95, abs=1e-3)


@both
def test_thrusts_that_are_no_numbers_are_an_error(kind: Kind) -> None:
    p = plant(kind)
    for _ in range(10):
        p.step((math.nan, 0.0, 0.0, 0.0))
    with pytest.raises(PlantError, match="diverged"):
        p.motion()


# Profiles and noise.


def test_all_profiles_are_there_and_say_why() -> None:
    assert list_profiles() == ("ardupilot-sitl", "cage", "nominal", "px4-sih")
    assert not any(NOMINAL.air.sigma_m_s)
    assert any(CAGE.air.sigma_m_s)
    folder = Path(load_profile.__code__.co_filename).parent / "profiles"
    for name in list_profiles():
        numbers = 0
        for line in (folder / f"{name}.yaml").read_text(encoding="utf-8").splitlines():
            numbers += line.strip().startswith("#")
        assert numbers > 5


def test_a_profile_takes_the_rest_from_its_base(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    head = "schema: wil/profile/1\ndescription: mine\nbase: cage\n"
    path.write_text(f"{head}airframe: {{mass_kg: 0.7}}\nbattery: {{full_v: 9}}\n")
    own, cage = load_profile(path), load_profile("cage")
    assert own.airframe is not None
    assert (own.airframe.mass_kg, own.airframe.arm_m) == (0.7, 0.175)
    assert own.battery == cage.battery.model_copy(update={"full_v": 9.0})
    assert own.estimator == cage.estimator
    path.write_text(head.replace("cage", "caeg"))
    with pytest.raises(BadInput, match=r"own\.yaml:3:7: 'caeg' is no profile .* mean 'cage'"):
        load_profile(path)
    path.write_text(f"{head}battery: {{ful_v: 9}}\n")
    with pytest.raises(BadInput, match=r"own\.yaml:4:11: unknown key 'ful_v'"):
        load_profile(path)


def test_a_wrong_profile_is_reported_at_the_place_of_each_fault(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="there are ardupilot-sitl, cage, nominal") as unknown:
        load_profile("caeg")
    assert unknown.value.suggestion == "cage"
    file = tmp_path / "mine.yaml"
    cage = (Path(load_profile.__code__.co_filename).parent / "profiles/cage.yaml").read_text()
    wrong = cage.replace("lag_s: 0.06", 'lag_s: "0.06"').replace("spread: 0.02", "spred: 0.02")
    file.write_text(wrong, encoding="utf-8")
    with pytest.raises(BadInput) as error:
        load_profile(file, shown_as="mine.yaml")
    lag, spread = error.value.problems
    assert lag.headline == (
        "mine.yaml:14:10: must be a number, is the text '0.06' (leave out the quotes)"
    )
    assert spread.headline == "mine.yaml:16:3: unknown key 'spred'; did you mean 'spread'?"
    file.write_bytes(b"\xff: [")
    with pytest.raises(BadInput, match=r"mine\.yaml:1:1: is not UTF-8"):
        load_profile(file)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("max_thrust_n", "4.0", "4 x 4.0 N do not lift 2.1 kg (20.6 N)"),
        ("mass_kg", "2100", "2100 kg is no quadrotor: at most 150 kg"),
        ("arm_m", "22.5", "22.5 m is no quadrotor: at most 3 m"),
        (
            "inertia_xx_kg_m2",
            "22",
            "22 kg m² is too much for 2.1 kg and arms of 0.225 m: at most 0.43 kg m²",
        ),
    ],
)
def test_an_airframe_that_cannot_fly_is_refused(
    tmp_path: Path, key: str, value: str, said: str
) -> None:
    numbers = {**AIRFRAME_NUMBERS, key: value}
    nominal = Path(load_profile.__code__.co_filename).parent / "profiles/nominal.yaml"
    given = "".join(f"  {name}: {number}\n" for name, number in numbers.items())
    file = tmp_path / "mine.yaml"
    file.write_text(f"{nominal.read_text('utf-8')}airframe:\n{given}", encoding="utf-8")
    with pytest.raises(BadInput) as error:
        load_profile(file, shown_as="mine.yaml")
    (problem,) = error.value.problems
    assert problem.message == said
    assert f"{key}: {value}" in str(problem)


@pytest.mark.parametrize(
    ("base", "shares"),
    [
        # The paper's drone has 2.32e-3 kg m² at 0.5 kg and arms of 0.175 m; PX4's 0.025 at 1 kg.
        ("nominal", (0.1515, 0.1515, 0.2612)),
        ("px4-sih", (0.3126, 0.3126, 0.3751)),
    ],
)
def test_an_inertia_left_out_grows_with_mass_and_arms(
    tmp_path: Path, base: str, shares: tuple[float, float, float]
) -> None:
    file = tmp_path / "mine.yaml"
    head = f"schema: wil/profile/1\ndescription: mine\nbase: {base}\n"
    file.write_text(f"{head}airframe: {{mass_kg: 2, arm_m: 0.3, max_thrust_n: 10}}\n")
    airframe = load_profile(file).airframe
    assert airframe is not None
    whole_kg_m2 = 2.0 * 0.3**2
    found = (airframe.inertia_xx_kg_m2, airframe.inertia_yy_kg_m2, airframe.inertia_zz_kg_m2)
    assert [one / whole_kg_m2 for one in found] == pytest.approx(shares, abs=1e-4)
    assert list(airframe.unusual()) == []
    file.write_text(f"{head}airframe: {{max_thrust_n: 10, inertia_zz_kg_m2: 0.04}}\n")
    given = load_profile(file).airframe
    before = load_profile(base).airframe or AirframeNumbers()
    assert given == before.model_copy(update={"max_thrust_n": 10.0, "inertia_zz_kg_m2": 0.04})


def test_arms_beyond_any_drone_are_a_fault_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    head = "schema: wil/profile/1\ndescription: big\nbase: nominal\n"
    for huge in ("arm_m: 1.0e+200", "mass_kg: 1.0e+300"):
        file.write_text(f"{head}airframe: {{{huge}}}\n")
        with pytest.raises(BadInput):
            load_profile(file)


def test_a_drone_of_strong_motors_needs_its_own_inertia(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    head = "schema: wil/profile/1\ndescription: big\nbase: nominal\n"
    big = "mass_kg: 0.7, arm_m: 0.175, max_thrust_n: 40"
    file.write_text(f"{head}airframe: {{{big}}}\n")
    with pytest.raises(BadInput) as error:
        load_profile(file, shown_as="mine.yaml")
    (problem,) = error.value.problems
    assert problem.headline == (
        "mine.yaml:4:11: 0.003248 kg m² is less than motors of 40 N on arms of 0.175 m have alone "
        "(0.0042): set inertia_xx_kg_m2 too, usually about 0.2 mass x arm², 0.0043 kg m²"
    )
    numbers = f"{big}, inertia_xx_kg_m2: 0.005, inertia_yy_kg_m2: 0.005"
    file.write_text(f"{head}airframe: {{{numbers}}}\n")
    with pytest.raises(BadInput, match=r"set inertia_zz_kg_m2 too, usually .* 0\.0086 kg m²"):
        load_profile(file)
    file.write_text(f"{head}airframe: {{{numbers}, inertia_zz_kg_m2: 0.009}}\n")
    assert load_profile(file).airframe is not None


@pytest.mark.parametrize(
    ("mass_kg", "roll_kg_m2", "yaw_kg_m2", "arm_m", "max_thrust_n"),
    [
        (0.027, 1.4e-5, 2.17e-5, 0.046, 0.15),  # of the hand's size
        (0.752, 2.1e-3, 4.3e-3, 0.15, 8.5),  # a racer
        (120.0, 30.0, 60.0, 1.5, 800.0),  # lifts a load
    ],
)
def test_drones_of_all_sizes_have_the_inertia_of_their_motors(
    mass_kg: float, roll_kg_m2: float, yaw_kg_m2: float, arm_m: float, max_thrust_n: float
) -> None:
    AirframeNumbers(
        mass_kg=mass_kg,
        inertia_xx_kg_m2=roll_kg_m2,
        inertia_yy_kg_m2=roll_kg_m2,
        inertia_zz_kg_m2=yaw_kg_m2,
        arm_m=arm_m,
        max_thrust_n=max_thrust_n,
    )


def test_gauss_markov_noise_has_its_spread_and_its_time() -> None:
    walk = GaussMarkov(
        sigma=(0.5, 0.0, 2.0), time_constant_s=2.0, dt_s=0.04, rng=np.random.default_rng(5)
    )
    walked = np.array([walk.advance() for _ in range(200_000)])
    values = walked[:, 0]
    assert walked[:, 2].std() == pytest.approx(2.0, rel=0.05)
    assert not walked[:, 1].any()
    assert values.std() == pytest.approx(0.5, rel=0.05)
    assert values.mean() == pytest.approx(0.0, abs=0.03)
    lag = 50
    correlation = float(np.corrcoef(values[:-lag], values[lag:])[0, 1])
    assert correlation == pytest.approx(math.exp(-lag * 0.04 / 2.0), abs=0.05)


def test_silent_noise_draws_nothing() -> None:
    rng = np.random.default_rng(5)
    walk = GaussMarkov(sigma=(0.0, 0.0, 0.0), time_constant_s=2.0, dt_s=0.04, rng=rng)
    state = rng.bit_generator.state
    assert walk.advance() == (0.0, 0.0, 0.0)
    assert rng.bit_generator.state == state


def test_the_estimate_is_late_and_starts_at_its_origin() -> None:
    noise = NOMINAL.estimator.model_copy(
        update={"delay_s": 0.02, "velocity_sigma_m_s": (0.0, 0.0), "position_sigma_m": (0.0, 0.0)}
    )
    estimator = EmulatedEstimator(
        noise=noise, rate_hz=250, rng=np.random.default_rng(1), body=np.zeros(BODY_NUMBERS)
    )
    for step in range(100):
        truth = AT_REST._replace(position_ned_m=(step * 0.004, 0.0, 0.0))
        estimate = motion_of_array(estimator.estimate(array_of(truth)))
    # Five steps late.
    assert estimate.position_ned_m[0] == pytest.approx((99 - 5) * 0.004)
    noisy = EmulatedEstimator(
        noise=CAGE.estimator, rate_hz=250, rng=np.random.default_rng(1), body=np.zeros(BODY_NUMBERS)
    )
    assert noisy.estimate(array_of(AT_REST))[:3] == pytest.approx((0, 0, 0), abs=0.02)


def test_the_estimate_wanders_as_the_profile_says() -> None:
    estimator = EmulatedEstimator(
        noise=CAGE.estimator, rate_hz=250, rng=np.random.default_rng(3), body=np.zeros(BODY_NUMBERS)
    )
    truth = array_of(AT_REST)
    velocities = [estimator.estimate(truth)[3:6].tolist() for _ in range(250 * 400)]
    across, down = CAGE.estimator.velocity_sigma_m_s
    spread = np.array(velocities[::10]).std(axis=0)
    assert spread == pytest.approx([across, across, down], rel=0.25)


def test_motion_capture_is_noisy_and_late() -> None:
    feed = MotionCaptureFeed(
        noise=CAGE.mocap, source="real", physics_hz=250, rng=np.random.default_rng(1)
    )
    readings: list[Any] = []
    feed.add(readings.append)
    pose = Pose.of(1.0, 2.0, 3.0, yaw_rad=0.4)
    truths = [TruthSample(0.01 * k, pose, (0, 0, 0), False, False) for k in range(2000)]
    for truth in truths:
        feed.receive(truth)
    feed.deliver(0.005)
    assert readings == []
    feed.deliver(100.0)
    assert [reading.t_s for reading in readings] == [truth.t_s for truth in truths]
    offsets = np.array([r.pose.position_ned_m for r in readings]) - pose.position_ned_m
    assert offsets.std(axis=0) == pytest.approx([0.001] * 3, rel=0.1)
    angles = [angle_between(pose.q_wxyz, r.pose.q_wxyz) for r in readings]
    assert np.mean(angles) == pytest.approx(math.radians(0.2) * 1.6, rel=0.1)


@pytest.mark.parametrize("rate_hz", [1, 50, 120, 240, 250])
def test_motion_capture_samples_the_first_step_not_before_each_time(rate_hz: int) -> None:
    noise = CAGE.mocap.model_copy(update={"rate_hz": rate_hz})
    feed = MotionCaptureFeed(
        noise=noise, source="real", physics_hz=250, rng=np.random.default_rng(1)
    )
    assert feed.next_step == NEVER
    feed.add(lambda _: None, step=7)
    truth = TruthSample(0.0, Pose.of(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), False, False)
    steps = []
    while feed.next_step < 1000:
        steps.append(feed.next_step)
        feed.receive(truth)
    times = [math.ceil(number * 250 / rate_hz) for number in range(1000 * rate_hz // 250 + 1)]
    assert steps == [step for step in times if 7 < step < 1000]


def test_the_battery_drains_sags_and_fades() -> None:
    battery = SimulatedBattery(profile=CAGE.battery, hover_thrust_n=4.9)
    full = battery.charge
    assert full.remaining == 1.0
    assert battery.thrust_factor == 1.0
    for _ in range(600):
        battery.drain(4.9, 1.0)
    # Ten minutes of hover at 6.5 A out of 2700 mAh.
    assert battery.charge.remaining == pytest.approx(1.0 - (6.5 + 0.3) * 600 / 3.6 / 2700)
    assert battery.charge.voltage_v < full.voltage_v - 0.5
    assert 0.8 < battery.thrust_factor < 1.0
    set_remaining(battery, 0.01)
    assert battery.thrust_factor > 0.75
    set_remaining(battery, 0.0)
    assert battery.charge.remaining == 0.0
    assert battery.thrust_factor == 0.0
    battery.drain(4.9, 10.0)
    assert battery.charge.remaining == 0.0


def test_without_jsbsim_the_error_says_what_flies_instead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant_module, "jsbsim", None)
    with pytest.raises(
        PlantError, match=r"not installed here .* `physics: compiled`, attach or launch"
    ):
        plant()
