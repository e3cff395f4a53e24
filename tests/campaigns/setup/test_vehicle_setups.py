"""`vehicles:` and `preflight:` of a campaign: embedded, attached, launched."""

from pathlib import Path
from typing import Any

import pytest

from wil_campaign.plugins.ardupilot.launch import ArduPilotLaunch
from wil_campaign.plugins.firmware.px4_launch import Px4Launch
from wil_campaign.vehicles.embedded import profile
from wil_campaign.vehicles.links.link_conditions import KeySource
from wil_campaign.vehicles.links.link_strings import parse_link

REAL = """    link: embedded
    autopilot: px4
    profile: cage
    start: {north_m: 0, east_m: 0}
    pose_source: mocap
"""


def outside(files: Any, link: str, *more: str, autopilot: str = "px4") -> None:
    """Attach or launch the real vehicle."""
    lines = [f"link: {link}", f"autopilot: {autopilot}", *more]
    files.change(REAL, "".join(f"    {line}\n" for line in lines))


def program(folder: Path, name: str) -> Path:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("")
    file.chmod(0o755)
    if file.name == "arducopter":
        parameters = folder / "Tools" / "autotest" / "default_params" / "copter.parm"
        parameters.parent.mkdir(parents=True)
        parameters.touch()
    return file


def real(files: Any) -> Any:
    return next(iter(files.load().setups.values())).vehicles["real"]


def test_embedded_vehicles_have_ids_of_their_own(files: Any) -> None:
    vehicles = next(iter(files.load().setups.values())).vehicles
    assert [vehicle.system_id for vehicle in vehicles.values()] == [1, 2]
    assert all(vehicle.embedded and vehicle.attached is None for vehicle in vehicles.values())


def test_a_campaign_may_attach_a_vehicle(files: Any) -> None:
    outside(
        files,
        "serial:///dev/ttyACM0:921600",
        "system_id: 7",
        "signing: {file: keys/real.key}",
    )
    vehicle = real(files)
    assert vehicle.attached == parse_link("serial:///dev/ttyACM0:921600")
    assert (vehicle.embedded, vehicle.launch, vehicle.system_id) == (False, None, 7)
    assert vehicle.signing == KeySource("file", str(files.folder / "keys" / "real.key"))


def test_telemetry_fits_the_radio(files: Any) -> None:
    outside(files, "serial:///dev/ttyUSB0:57600")
    assert 15.0 <= real(files).rates.position_hz < 30.0


def test_a_radio_too_slow_is_reported_where_its_link_is(files: Any) -> None:
    outside(files, "serial:///dev/ttyUSB0:9600")
    (found,) = files.faults()
    assert "a radio of 7.68 kbit/s carries" in found


def test_a_campaign_may_launch_an_arducopter(files: Any) -> None:
    binary = program(files.folder, "bin/arducopter")
    (files.folder / "copter.parm").write_text("")
    outside(
        files,
        "{launch: ardupilot, binary: bin/arducopter, defaults: [copter.parm], frame: hexa}",
        autopilot="ardupilot",
    )
    assert real(files).launch == ArduPilotLaunch(
        binary=binary, frame="hexa", defaults=(files.folder / "copter.parm",)
    )


def test_a_campaign_may_launch_a_px4(files: Any) -> None:
    program(files.folder, "build/bin/px4")
    program(files.folder, "build/etc/init.d-posix/rcS")
    outside(files, "{launch: px4, build: build, model: gz_x500}", "params: {B: 2, A: 0.5}")
    assert real(files).launch == Px4Launch(
        build=files.folder / "build", model="gz_x500", params=(("A", 0.5), ("B", 2.0))
    )


FAST = "{launch: ardupilot, binary: ./arducopter, speedup: 4}"


def test_an_embedded_vehicle_follows_a_launched_one_at_any_pace(files: Any) -> None:
    program(files.folder, "arducopter")
    outside(files, FAST, autopilot="ardupilot")
    setup = next(iter(files.load().setups.values()))
    assert setup.pace("wil") == 4.0
    assert setup.pace("sim") is None


TWIN = """  twin:
    link: embedded
    autopilot: ardupilot
"""


@pytest.mark.parametrize(
    ("twin", "said", "remedy"),
    [
        (
            "link: {launch: ardupilot, binary: ./arducopter, speedup: 3}",
            "the other vehicle flies at 4 times",
            "both need the same",
        ),
        (
            "link: udpin://127.0.0.1:14541",
            "twin is attached and runs in real time",
            "remove 'speedup'",
        ),
    ],
)
def test_paces_that_contradict_each_other_are_reported(
    files: Any, twin: str, said: str, remedy: str
) -> None:
    program(files.folder, "arducopter")
    outside(files, FAST, autopilot="ardupilot")
    files.change(TWIN, TWIN.replace("link: embedded", twin))
    found = {fault for fault in files.faults() if said in fault}
    assert len(found) == 1
    assert remedy in found.pop()


def test_the_pace_of_a_launched_simulation_is_its_link_s(files: Any) -> None:
    program(files.folder, "arducopter")
    outside(files, FAST, autopilot="ardupilot")
    files.change("seed:", "clock: {speed: 3}\nseed:")
    (found,) = set(files.faults())
    assert "the link of a launched simulation sets the speed to 4; remove this key" in found


@pytest.mark.parametrize(
    ("link", "autopilot", "said"),
    [
        ("{launch: ardupilot, binary: nowhere/copter}", "ardupilot", "there is no program"),
        ("{launch: px4, build: nowhere}", "px4", "there is no build folder"),
        ("{launch: px4}", "px4", "give the build folder, or the image"),
        ("{launch: px4, build: a, image: b}", "px4", "give the build folder, or the image"),
        ("{launch: betaflight}", "px4", "must be ardupilot or px4, is 'betaflight'"),
        ("{launch: px4, build: a, speedup: 2}", "px4", "unknown key 'speedup'; did you mean"),
        ("{launch: px4, build: a, speed: 0}", "px4", "must be greater than 0"),
        ("{launch: ardupilot, binary: a}", "px4", "the link launches ardupilot"),
        ("{}", "px4", "missing key 'launch'"),
        ("memory://", "px4", "connects to nothing outside this program"),
        ("udp:0.0.0.0:14540", "px4", "did you mean udpin://0.0.0.0:14540?"),
        ("12", "px4", "must be text"),
    ],
)
def test_a_wrong_link_is_reported(files: Any, link: str, autopilot: str, said: str) -> None:
    outside(files, link, autopilot=autopilot)
    found = files.faults()
    assert len(found) == 1, found
    assert said in found[0]
    assert found[0].startswith("campaign.yaml:")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("pose_source: mocap", "only the embedded vehicle has built-in motion capture"),
        ("signing: {}", "give a file, or the name of an environment variable"),
        ("signing: {file: a, environment: b}", "give a file, or the name"),
        ("system_id: 0", "must be at least 1"),
        ("telemetry: {rate_hz: 5}", "must be at least 10"),
        ("telemetry: {bandwidth_kbit_s: 9.6}", "a radio of 9.6 kbit/s carries"),
        ("system_id: 2", "both vehicles have system id 2"),
    ],
)
def test_a_key_that_an_attached_vehicle_cannot_have_is_refused(
    files: Any, line: str, said: str
) -> None:
    outside(files, "udpin://0.0.0.0:14540", line)
    found = files.faults()
    assert len(found) == 1, found
    assert said in found[0]


@pytest.mark.parametrize(
    ("link", "said"),
    [
        ("{launch: px4, build: a}", "a launched simulation is judged by its ground truth: write"),
        ("udpin://0.0.0.0:14540", "by `mocap`, or write simulator (a simulation's ground truth)"),
    ],
)
def test_without_motion_capture_the_ground_truth_is_offered(
    files: Any, link: str, said: str
) -> None:
    """As to whoever launches a firmware in a shipped campaign, whose real one is captured."""
    outside(files, link, "pose_source: mocap")
    (fault,) = files.faults()
    assert said in fault


def test_sensors_that_only_our_own_simulation_feels(files: Any) -> None:
    outside(files, "udpin://0.0.0.0:14540")
    text = files.path.read_text()
    at = text.index("    sensors:\n") + len("    sensors:\n")
    files.path.write_text(text[:at] + "      imu: {type: imu}\n" + text[at:])
    (fault,) = files.faults()
    assert "only the embedded vehicle's imu is modelled; give the source" in fault


def test_the_embedded_vehicle_does_not_sign(files: Any) -> None:
    files.change("    profile: cage\n", "    profile: cage\n    signing: {environment: KEY}\n")
    (fault,) = files.faults()
    assert "the embedded vehicle does not sign" in fault


def test_a_vehicle_without_gps(files: Any) -> None:
    outside(files, "udpin://0.0.0.0:14540", "pose_source: mavlink", "gps: false")
    assert not real(files).has_gps


def test_the_embedded_vehicle_has_gps(files: Any) -> None:
    files.change("    profile: cage\n", "    profile: cage\n    gps: false\n")
    (fault,) = files.faults()
    assert "the embedded vehicle flies by GPS; remove it" in fault


def test_parameters_that_the_embedded_autopilot_does_not_have(files: Any) -> None:
    files.change("    profile: cage\n", "    profile: cage\n    params: {COM_OF_LOST_T: 2}\n")
    (fault,) = files.faults()
    assert (
        "the embedded px4 has no parameter 'COM_OF_LOST_T'; did you mean 'COM_OF_LOSS_T'" in fault
    )


def test_faults_of_a_profile_are_reported_in_its_own_file(files: Any) -> None:
    cage = (Path(profile.__file__).parent / "profiles" / "cage.yaml").read_text()
    (files.folder / "hall.yaml").write_text(cage.replace("spread: 0.02", "spread: 2"))
    files.change("    profile: cage\n", "    profile: hall.yaml\n")
    (fault,) = files.faults()
    assert "hall.yaml:16:11: must be at most 0.2, is 2" in fault
    files.change("    profile: hall.yaml\n", "    profile: hull.yaml\n")
    (fault,) = files.faults()
    assert (
        "campaign.yaml:7:14: there is no file 'hull.yaml' beside the campaign; did you mean "
        "'hall.yaml'?" in fault
    )


def test_a_body_of_its_own_is_judged_and_has_to_stand_free(files: Any) -> None:
    setup = files.load().runs[0].setup()
    assert setup.vehicles["real"].body.half_m == pytest.approx((0.15, 0.15, 0.05))
    files.change("profile: cage\n", "profile: cage\n    body: {width_m: 0.5, height_m: 0.2}\n")
    setup = files.load().runs[0].setup()
    assert setup.vehicles["real"].body.half_m == pytest.approx((0.25, 0.25, 0.1))
    assert setup.vehicles["twin"].body.half_m == pytest.approx((0.15, 0.15, 0.05))
    files.change("body: {width_m: 0.5,", "body: {width_m: 8,")
    assert any("'real' starts inside" in fault for fault in files.faults())


def test_one_link_for_two_vehicles_is_reported(files: Any) -> None:
    outside(files, "udpin://0.0.0.0:14540")
    files.change("    link: embedded\n", "    link: udpin://0.0.0.0:14540\n")
    (fault,) = files.faults()
    assert "each needs its own link" in fault


def test_more_links_to_one_vehicle(files: Any) -> None:
    outside(files, "udpin://0.0.0.0:14540")
    text = files.path.read_text()
    at = text.index("    link: udpin://0.0.0.0:14540\n")
    spares = "    spare_links: [serial:///dev/ttyUSB0:57600, udpin://0.0.0.0:14550]\n"
    files.path.write_text(text[:at] + spares + text[at:])
    real = next(iter(files.load().setups.values())).vehicles["real"]
    assert list(map(str, real.addresses)) == [
        "udpin://0.0.0.0:14540",
        "serial:///dev/ttyUSB0:57600",
        "udpin://0.0.0.0:14550",
    ]
    assert real.rates.position_hz < 50.0  # as the slowest radio carries them


@pytest.mark.parametrize(
    ("spares", "said"),
    [
        ("[udpin://0.0.0.0:14540]", "udpin://0.0.0.0:14540 is named twice"),
        ("[embedded]", "must be a link; the embedded vehicle has its own"),
        ("[udp:14550]", "cannot be read"),
    ],
)
def test_a_wrong_spare_link_is_reported(files: Any, spares: str, said: str) -> None:
    outside(files, "udpin://0.0.0.0:14540")
    text = files.path.read_text()
    at = text.index("    link: udpin://0.0.0.0:14540\n")
    files.path.write_text(text[:at] + f"    spare_links: {spares}\n" + text[at:])
    (fault,) = files.faults()
    assert said in fault


def test_the_embedded_vehicle_has_one_link(files: Any) -> None:
    files.change("    profile: cage\n", "    profile: cage\n    spare_links: [udpin://0.0.0.0:9]\n")
    (fault,) = files.faults()
    assert "only a vehicle with its own link can have more" in fault


def test_the_onboard_fence_has_a_margin_or_is_switched_off(files: Any) -> None:
    preflight = next(iter(files.load().setups.values())).preflight
    assert preflight.fence is not None
    assert preflight.fence.margin_m == 1.0
    files.append("preflight: {fence: null, min_battery: 0.5}\n")
    preflight = next(iter(files.load().setups.values())).preflight
    assert (preflight.fence, preflight.min_battery) == (None, 0.5)


def test_an_unknown_key_of_preflight_is_reported(files: Any) -> None:
    files.append("preflight: {fence: {margin: 2}}\n")
    (fault,) = files.faults()
    assert "unknown key 'margin'" in fault


@pytest.mark.parametrize(
    ("said", "source", "requested"),
    [
        ((), "simulator", True),
        (("pose_source: mavlink",), "mavlink", True),
        (("pose_source: simulator",), "simulator", True),
    ],
)
def test_a_launched_vehicle_is_judged_by_its_simulator_by_default(
    files: Any, tmp_path: Path, said: tuple[str, ...], source: str, requested: bool
) -> None:
    binary = program(tmp_path, "arducopter")
    outside(files, f"{{launch: ardupilot, binary: {binary}}}", *said, autopilot="ardupilot")
    vehicle = real(files)
    assert (vehicle.pose_source, vehicle.requests_truth) == (source, requested)
    assert vehicle.pose_accuracy.position_m == (0.02 if source == "simulator" else 1.0)


@pytest.mark.parametrize("link", ["udpin://0.0.0.0:14540", "embedded"])
@pytest.mark.parametrize(
    ("said", "source", "truth_hz"),
    [((), "mavlink", 0.0), (("pose_source: simulator",), "simulator", 50.0)],
)
def test_any_vehicle_may_have_a_simulator_and_none_has_one_unsaid(
    files: Any, link: str, said: tuple[str, ...], source: str, truth_hz: float
) -> None:
    outside(files, link, *said)
    vehicle = real(files)
    assert (vehicle.pose_source, vehicle.rates.truth_hz) == (source, truth_hz)
    assert vehicle.requests_truth is (source == "simulator")
