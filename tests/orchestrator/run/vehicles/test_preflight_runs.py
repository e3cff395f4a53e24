"""Preflight in a run: what is refused never arms, what is overridden says by whom."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from tests.orchestrator.conftest import BRIEF, Fly, NoCommands
from tests.orchestrator.flights import log_of
from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.workers.run_order import fly_order
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.run.vehicles import onboard_fences
from wil_campaign.orchestrator.run.vehicles.preflight_checks import PreflightChecks
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.safety.preflight import PreflightItem
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.driver.onboard.fence_protocol import AutopilotFence
from wil_campaign.vehicles.embedded.autopilot.px4 import px4_telemetry
from wil_campaign.vehicles.mavlink.fence_areas import FencePlace, FencePolygon
from wil_campaign.vehicles.poses.anchor import Anchor

FENCE = "geofence={box: {north_m: [-3, 3], east_m: [-3, 3], up_m: [-1, 2.4]}}"
ARDUPILOT = "vehicles.twin.autopilot=ardupilot"


class Flight(NamedTuple):
    result: RunResult
    armed: bool
    folder: Path

    def item(self, check: str) -> PreflightItem:
        (found,) = [item for item in self.result.preflight if item.check == check]
        return found


@pytest.fixture
def hover(tmp_path: Path) -> Any:
    path = write_hover(tmp_path)

    def fly(*sets: str) -> Flight:
        (plan, *_) = load_campaign(path, ExpansionOptions(sets=sets)).runs
        folder = tmp_path / "out" / plan.name
        order = RunOrder(plan=plan, folder=folder, clock="virtual")
        result = fly_order(order, lambda _: None, NoCommands())
        armed = any(line.get("kind") == "armed" for line in log_of(folder))
        return Flight(result, armed, folder)

    return fly


ON_EARTH = """geofence={up_m: [-1, 5], include: [{polygon_deg: [
    [47.39995, 8.49995], [47.40005, 8.49995], [47.40005, 8.50005], [47.39995, 8.50005]]}]}"""


ATTACHED = "udpin://127.0.0.1:14555"
PLACE_DEG = 47.4, 8.5


@pytest.mark.parametrize(
    ("given", "place_deg", "turn_rad", "outcomes"),
    [
        ((ON_EARTH, ATTACHED, "start"), (47.4, 8.50001), 0.1, ["ok"]),
        ((ON_EARTH, ATTACHED, "start"), (47.4, 8.5004), 0.0, ["refused"]),
        ((ON_EARTH, ATTACHED, "start"), PLACE_DEG, 1.0, ["refused"]),
        ((ON_EARTH, ATTACHED, "start"), None, 0.0, ["refused"]),
        ((ON_EARTH, ATTACHED, "mocap"), (47.4, 8.5004), 0.0, []),
        ((ON_EARTH, "embedded", "start"), (47.4, 8.5004), 0.0, []),
        ((FENCE, ATTACHED, "start"), (47.4, 8.5004), 0.0, []),
    ],
)
def test_a_fence_in_degrees_is_not_shifted_with_an_attached_vehicle(
    tmp_path: Path,
    given: tuple[str, str, Any],
    place_deg: tuple[float, float] | None,
    turn_rad: float,
    outcomes: list[str],
) -> None:
    """Its world begins where it stands; the fence was drawn elsewhere on the map."""
    fence, link, anchor = given
    options = ExpansionOptions(sets=(fence, f"vehicles.twin.link={link}"))
    ((_, case),) = load_campaign(write_hover(tmp_path), options).setups.items()
    twin = replace(case.vehicles["twin"], anchor=anchor)
    setup: Any = SimpleNamespace(
        case=replace(case, vehicles={"twin": twin}), flown=lambda _: twin, vehicle=lambda _: twin
    )
    driver = SimpleNamespace(place_deg=place_deg, anchor=Anchor((0.0, 0.0, 0.0), turn_rad))
    context: Any = SimpleNamespace(name="twin", driver=driver)
    items = PreflightChecks(setup=setup, note=lambda *_, **__: None)._place(context)
    assert [item.outcome for item in items] == outcomes


def test_preflight_checks_are_in_the_result_and_the_log(fly_run: Fly) -> None:
    result, folder = fly_run(sets=BRIEF)
    assert {item.outcome for item in result.preflight} == {"ok"}
    found = [(item.check, item.vehicle) for item in result.preflight]
    first = ["failsafe", "return_altitude", "battery", "estimator", "position"]
    sources = {"real": ["mocap", "mocap"], "twin": ["gps", "gps"]}
    both = [
        (check, vehicle)
        for vehicle, source in sources.items()
        for check in (*first, *source, "clock", "home")
    ]
    assert found == [("disk", ""), *both, ("pair", "")]
    noted = [line for line in log_of(folder) if line.get("event") == "preflight"]
    assert [(line["check"], line["vehicle"]) for line in noted] == found


def test_steps_before_arming_are_recorded_in_their_order(fly_run: Fly) -> None:
    result, folder = fly_run(sets=BRIEF)
    steps = result.before_arming
    of_each = [("parameters", "real"), ("fence", "real"), ("parameters", "twin"), ("fence", "twin")]
    assert sorted((step.step, step.vehicle) for step in steps[:4]) == sorted(of_each)
    for vehicle in ("real", "twin"):
        order = [step.step for step in steps if step.vehicle == vehicle]
        assert order == ["parameters", "fence"]
    assert [(step.step, step.vehicle) for step in steps[4:]] == [
        ("external", ""),
        ("preflight", ""),
    ]
    assert {step.ok for step in steps} == {True}
    assert {step.restored for step in steps} == {None}  # they end with the run
    assert [step.at_s for step in steps] == sorted(step.at_s for step in steps)
    assert steps[-1].text == f"{len(result.preflight)} checks"
    assert "RTL_RETURN_ALT 1.725" in next(step.text for step in steps if step.step == "parameters")
    noted = [line for line in log_of(folder) if line.get("event") == "before_arming"]
    assert [(line["step"], line["text"]) for line in noted] == [(o.step, o.text) for o in steps]


def test_the_step_that_prevents_arming_is_the_last(hover: Any) -> None:
    flight = hover("preflight.start_tolerance_m=1e-12")
    *before, last = flight.result.before_arming
    assert (last.step, last.ok) == ("preflight", False)
    assert last.text == flight.result.reason
    assert all(one.ok for one in before)
    assert not flight.armed


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (("preflight.start_tolerance_m=1e-12",), "twin position: its distance from its start po"),
        (("preflight.max_clock_error_s=1e-12",), "twin clock: the uncertainty of its clock is"),
        (("vehicles.twin.params={NAV_DLL_ACT: 0}",), "NAV_DLL_ACT is 0: on link loss it would not"),
        (
            (ARDUPILOT, "vehicles.twin.params={FS_GCS_ENABLE: 0}"),
            "on link loss it would hover until its batt",
        ),
        ((FENCE, "vehicles.twin.params={RTL_RETURN_ALT: 60}"), "is 60 m, and at most 2.4 m is al"),
        ((ARDUPILOT, FENCE, "vehicles.twin.params={RTL_ALT: 1500}"), "is 15 m, and at most 2.4"),
        (
            (FENCE, "preflight.failsafe=check"),
            "twin return_altitude: its RTL altitude is 30",
        ),
        ((FENCE, "geofence.keep_m=0.99", "preflight.start_tolerance_m=1e-12"), "twin position"),
    ],
)
def test_a_vehicle_that_the_preflight_refuses_never_arms(
    hover: Any, sets: tuple[str, ...], said: str
) -> None:
    flight = hover(*sets)
    assert flight.result.verdict == "ERROR"
    assert flight.result.reason.startswith("preflight: ")
    assert said in flight.result.reason
    assert not flight.armed
    assert any(item.outcome == "refused" for item in flight.result.preflight)


@pytest.mark.usefixtures("forked_workers")
def test_an_overridden_check_lets_it_fly_and_names_the_person(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = ("vehicles.twin.params={NAV_DLL_ACT: 0}", "preflight.override.failsafe=J. Doe")
    words = [word for one in sets for word in ("--set", one)]
    given = ("--out", str(tmp_path / "out"), "--jobs", "1")
    assert main(["run", str(write_hover(tmp_path)), *given, *words]) == 0
    (summary,) = (tmp_path / "out").rglob("summary.json")
    for run in json.loads(summary.read_text("utf-8"))["runs"]:
        assert run["verdict"] == "PASS"
        (item,) = [one for one in run["preflight"] if one["check"] == "failsafe"]
        assert (item["outcome"], item["by"]) == ("overridden", "J. Doe")
        assert item["text"].startswith("NAV_DLL_ACT is 0")
    said = " ".join(capsys.readouterr().out.split())
    assert "preflight, 2 of 2 runs: twin failsafe: NAV_DLL_ACT is 0" in said
    assert "(overridden by J. Doe)" in said
    assert "accepted; preflight overridden by J. Doe" in said
    (junit,) = (tmp_path / "out").rglob("junit.xml")
    assert '<property name="overridden" value="twin failsafe by J. Doe"/>' in junit.read_text(
        "utf-8"
    ).replace(" />", "/>")


@pytest.mark.parametrize("sets", [(FENCE,), (ARDUPILOT, FENCE)])
def test_a_return_is_set_beneath_a_low_ceiling(hover: Any, sets: tuple[str, ...]) -> None:
    flight = hover(*sets)
    assert flight.result.verdict == "PASS", flight.result.reason
    item = flight.item("return_altitude")
    assert (item.outcome, item.limit) == ("ok", 2.4)
    assert item.actual == pytest.approx(1.8)


def test_an_older_px4_that_climbs_higher_than_the_campaign_wants_never_arms(
    hover: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(px4_telemetry, "_FLIGHT_VERSION", 1 << 24 | 14 << 16 | 4 << 8 | 255)
    flight = hover()
    item = flight.item("takeoff_height")
    assert (flight.armed, item.outcome, item.actual, item.limit) == (False, "refused", 2.5, 1.2)
    assert (
        "twin takeoff_height: its MIS_TAKEOFF_ALT, to which PX4 1.14.4 climbs at least, is 2.5 m, "
        "and at most 1.2 m is allowed"
    ) in flight.result.reason
    assert Px4().least_takeoff_parameter((0, 0, 0)) is None  # a build without a version
    shutil.rmtree(flight.folder)
    flight = hover("vehicles.twin.params={MIS_TAKEOFF_ALT: 1.2}")
    assert flight.item("takeoff_height").outcome == "ok"


def test_a_fence_that_the_autopilot_refuses_is_an_error_before_arming(
    hover: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = tuple(FencePlace(48.0 + lat, 9.0 + lon) for lat, lon in ((0, 0), (0.1, 0), (0.1, 0.1)))
    excluding = AutopilotFence(areas=(FencePolygon(far),), ceiling_m=5.0)
    monkeypatch.setattr(onboard_fences, "onboard_fence_of", lambda *_, **__: excluding)
    flight = hover(FENCE)
    assert flight.result.verdict == "ERROR"
    assert "fence: it was refused with" in flight.result.reason
    assert not flight.armed


def test_a_fence_that_comes_back_otherwise_is_an_error_before_arming(
    hover: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "wil_campaign.vehicles.driver.onboard.mission_protocol._difference",
        lambda *_: "item 2 came back as 0",
    )
    flight = hover(FENCE)
    assert flight.result.verdict == "ERROR"
    assert "fence: item 2 came back as 0" in flight.result.reason
    assert not flight.armed


def test_a_disk_without_room_is_reported_before_the_first_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=5_000_000))
    out = tmp_path / "out"
    assert main(["run", str(write_hover(tmp_path)), "--out", str(out)]) == 3
    said = capsys.readouterr().err
    assert "is 5 MB, and at least 200 MB is required; free space, or lower" in said
    assert not list(out.rglob("result.json"))


def test_the_preflight_shows_that_commands_are_not_signed(hover: Any) -> None:
    def operator_items(commands: str) -> list[PreflightItem]:
        mqtt = f"{{broker: 'mqtt://127.0.0.1', commands: {commands}}}"
        flown = hover(f"operator.mqtt={mqtt}")
        assert flown.result.verdict == "PASS"
        shutil.rmtree(flown.folder)
        return [item for item in flown.result.preflight if item.check == "operator"]

    (item,) = operator_items("unsigned")
    assert (item.outcome, item.by) == ("overridden", "operator.mqtt.commands: unsigned")
    assert "every client that may publish at the broker can command the flight" in item.text
    assert operator_items("signed") == []
