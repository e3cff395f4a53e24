"""`wil-campaign doctor --vehicle LINK --fly`: what is refused, printed and returned, and a landing.

The flight itself is tested in virtual time, by tests/vehicles/embedded/fidelity.
"""

import json
import math
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

import wil_campaign
from tests.orchestrator.cli.test_arming_consent import Speaker
from tests.plugins.python.test_mock_vehicle import wait
from tests.ports import free_port
from tests.test_house import ROOT
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_links
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import AttachedVehicle
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.doctor import vehicle_check
from wil_campaign.plugins.step_response import vehicle_flight
from wil_campaign.plugins.step_response.comparison import FigureRow
from wil_campaign.plugins.step_response.event_order import OrderRow
from wil_campaign.plugins.step_response.step_responses import (
    EstimateError,
    FlownStepResponses,
    OperatorAbortError,
)
from wil_campaign.vehicles.driver.session.identity import VehicleIdentity
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.worlds.frames import Pose

FLY = ("doctor", "--vehicle", "udpin://127.0.0.1:14540", "--fly", "--arm-real")
SITL = AttachedVehicle(
    name="vehicle",
    address="udpin://127.0.0.1:14540",
    identity=VehicleIdentity(
        autopilot="px4",
        system_id=1,
        component_id=1,
        vehicle_type="quadrotor",
        version=(1, 18, 0),
        version_text="1.18.0",
        git_hash="",
        uid="4954414c44494e4f",
        capabilities=0,
        simulation=True,
    ),
    place_deg=None,
    battery=None,
    armed=False,
)
BESIDE = tuple(FigureRow("yaw 60", "t90_s", (0.8, 0.8), 0.8, off) for off in (0.152, -0.149))
ALIKE = FlownStepResponses(
    (FigureRow("yaw 60", "t90_s", (0.82, 0.84), 0.8, -0.024),),
    (OrderRow("arming", ("acknowledged", "armed"), ("acknowledged", "armed")),),
)
DIFFERENT = FlownStepResponses(
    (
        FigureRow("yaw 60", "t90_s", (0.82, 0.84), 1.3, 0.55),
        FigureRow("speed 0.4", "t90_s", (1.0, 1.1), None, math.inf),
    ),
    (OrderRow("arming", ("acknowledged", "armed"), ("armed", "acknowledged")),),
    0.52,
)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("doctor", "--fly"), "--fly: name the simulator by --vehicle LINK"),
        ((*FLY, "campaign.yaml"), "leave the campaign files out"),
        (("doctor", "--vehicle", "udp:14540"), "cannot be read"),
        (("doctor", "--vehicle", "memory://"), "no other process can use this link"),
        (FLY[:-1], "it may be hardware, and is armed only with --arm-real"),
    ],
)
def test_wrong_arguments_are_refused_before_any_contact(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert said in capsys.readouterr().err


def test_the_vehicle_is_only_identified_without_fly(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(vehicle_check, "find_vehicle_to_arm", lambda _: SITL)
    assert main(FLY[:3]) == 0
    assert "px4 1.18.0 quadrotor, system 1, a simulation" in capsys.readouterr().out
    assert main([*FLY[:3], "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["version"] == "1.18.0"


def test_a_board_is_refused_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    link = f"udpin://127.0.0.1:{port}"
    with Speaker(port).speaking():
        assert main(["doctor", "--vehicle", link, "--fly", "--arm-real"]) == 2
    said = capsys.readouterr().err
    assert "vehicle reports a board (000000000000004d), not a simulation" in said
    assert "start the firmware as SITL" in said


def test_a_vehicle_that_a_campaign_flies_is_not_touched(
    capsys: pytest.CaptureFixture[str],
) -> None:
    link = f"udpout://127.0.0.1:{free_port()}"
    with held_links((parse_link(link),)):
        assert main(["doctor", "--vehicle", link, "--fly", "--arm-real"]) == 3
    assert capsys.readouterr().err.startswith(f"the vehicle at {link} is in use by another")


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Any]:
    """Give what flights come to; nothing flies."""
    given: list[Any] = []

    def fly(*_: object, **__: object) -> FlownStepResponses:
        if isinstance(given[0], Exception):
            raise given[0]
        assert isinstance(given[0], FlownStepResponses)
        return given[0]

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(vehicle_flight, "fly_step_responses", fly)
    monkeypatch.setattr(vehicle_flight, "clear_vehicle", lambda *_, **__: SITL)
    return given


def test_the_table_marks_figures_within_and_beyond_the_limit(
    flown: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    flown[:] = [ALIKE]
    assert main(FLY) == 0
    said = capsys.readouterr().out
    assert "its simulator sent no ground truth" in said
    assert "yaw 60 t90_s   0.8       0.82 to 0.84          -2%         in" in said
    assert said.endswith("px4 1.18.0 flies as PX4 of August 2026 in SIH: 2 of 2 within 15%\n")
    flown[:] = [DIFFERENT]
    assert main(FLY) == 1
    said = capsys.readouterr().out
    assert "+55%           out" in said
    assert "not reached    out" in said
    assert "armed > acknowledged  acknowledged > armed  another order  out" in said
    assert said.endswith("px4 1.18.0 differs from PX4 of August 2026 in SIH in 3 of 3\n")
    off = "its estimate was up to 0.52 m from its simulator's ground truth; judge it by its ground"
    assert off in said
    flown[:] = [replace(ALIKE, estimate_off_m=0.1004, figures=BESIDE)]
    assert main(FLY) == 1
    said = capsys.readouterr().out
    ends = [line.split()[-2:] for line in said.splitlines() if line.startswith("yaw 60")]
    assert ends == [["+15.2%", "out"], ["-14.9%", "in"]]
    assert "up to 0.1004 m from its simulator's ground truth; judge it by" in said
    flown[:] = [replace(ALIKE, estimate_off_m=0.04)]
    assert main(FLY) == 0
    assert "up to 0.04 m from its simulator's ground truth\n" in capsys.readouterr().out


def test_the_estimate_is_compared_with_the_truth_of_its_time() -> None:
    """That of an unmodified PX4 1.16 in SIH was half a metre off, and nothing said so."""

    def at(t_s: float, north_m: float) -> EstimateSample:
        return EstimateSample(t_s, t_s, t_s, Pose((north_m, 0.0, -1.0)), (1.0, 0.0, 0.0))

    error = EstimateError()
    error.truth(at(0.9, 5.0))
    assert error.most_m is None
    for tick in range(20):
        error.estimate(at(1.0 + 0.02 * tick, 0.02 * tick))
    error.truth(at(1.1, 0.1))
    assert error.most_m == pytest.approx(0.0, abs=1e-9)
    error.truth(at(1.2, 0.7))
    error.truth(at(9.0, 99.0))
    assert error.most_m == pytest.approx(0.5)


def test_a_firmware_without_figures_is_refused_before_it_flies(
    flown: list[Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As that of an autopilot of another plugin."""
    flown[:] = [ALIKE]
    other = replace(SITL, identity=replace(SITL.identity, autopilot="third"))
    monkeypatch.setattr(vehicle_flight, "clear_vehicle", lambda *_, **__: other)
    assert main(FLY) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(
        "--fly: the figures of px4 and ardupilot are known, not of third"
    )
    assert captured.out == ""
    assert not Path("results").exists()


def test_json_is_one_document(flown: list[Any], capsys: pytest.CaptureFixture[str]) -> None:
    flown[:] = [DIFFERENT]
    assert main([*FLY, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert (document["beyond"], document["total"], document["limit"]) == (3, 3, 0.15)
    assert document["vehicle"]["simulation"] is True
    assert [row["difference"] for row in document["figures"]] == [0.55, None]
    assert [row["within"] for row in (*document["figures"], *document["orders"])] == [False] * 3


@pytest.mark.parametrize(
    ("error", "code"), [(VehicleError("lost"), 3), (OperatorAbortError("by"), 4)]
)
def test_a_flight_that_ends_early_has_the_exit_code_of_runs(
    flown: list[Any], capsys: pytest.CaptureFixture[str], error: VehicleError, code: int
) -> None:
    flown[:] = [error]
    assert main(FLY) == code
    captured = capsys.readouterr()
    assert str(error) in captured.err
    assert captured.out == ""


def test_ctrl_c_lands_and_disarms_first_however_often(tmp_path: Path) -> None:
    with wil_campaign.mock_vehicle("ardupilot") as vehicle:
        with subprocess.Popen(  # noqa: S603 - our own interpreter
            [
                *(sys.executable, "-m", "wil_campaign", "doctor", "--vehicle", vehicle.url),
                *("--fly", "--arm-real", "--out", str(tmp_path)),
            ],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        ) as program:
            assert program.stderr is not None
            said = [next(program.stderr)]
            while said[-1] != "takeoff\n":
                said.append(next(program.stderr))
            wait(lambda: "command 22 result 0" in vehicle.output)
            os.kill(program.pid, signal.SIGINT)  # before it has left the ground, or just after
            assert "bring down\n" in iter(program.stderr.readline, "")
            os.kill(program.pid, signal.SIGINT)
            os.kill(program.pid, signal.SIGTERM)
            said += program.stderr.readlines()
        assert program.returncode == 130, said
        link = mavutil.mavlink_connection(vehicle.device)
        assert not link.wait_heartbeat(timeout=10).base_mode & 128
        link.close()
