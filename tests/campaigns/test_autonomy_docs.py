"""docs/autonomy.md: its class is an autonomy that does what it says, its figures are the code's."""

import math
import re
from types import ModuleType

import numpy as np
import pytest

import wil_campaign.api
from tests.test_house import ROOT
from wil_campaign.api import CameraReading, Command, Intrinsics, Pose, Telemetry, VelocitySetpoint
from wil_campaign.campaigns.schema import AutonomyPart
from wil_campaign.campaigns.values.autonomy_limits import AutonomyLimits
from wil_campaign.orchestrator.run.perception import autonomy_calls

PAGE = (ROOT / "docs" / "autonomy.md").read_text("utf-8")
(CODE,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
LENS = Intrinsics.from_fov(320, 240, math.radians(69.0))


def built(**parameters: object) -> wil_campaign.api.Autonomy:
    module = ModuleType("my_autonomy")
    exec(compile(CODE, "docs/autonomy.md", "exec"), vars(module))  # noqa: S102 - our own page
    made = module.ThroughOrange(goal={"altitude_m": 1.2}, parameters=parameters, seed=1)
    assert isinstance(made, wil_campaign.api.Autonomy)
    return made


def image(t_s: float, column: int, rows: tuple[int, int] = (100, 140)) -> CameraReading:
    """Return an image with an orange bar around a column."""
    image_bgr = np.full((240, 320, 3), 90, np.uint8)
    image_bgr[slice(*rows), column - 20 : column + 20] = (0, 120, 255)
    return CameraReading(t_s, t_s + 0.05, 0, "real", image_bgr, LENS)


def telemetry(yaw_rad: float, t_s: float) -> Telemetry:
    return Telemetry(t_s, Pose.of(0.0, 0.0, 1.2, yaw_rad=yaw_rad), (0.0, 0.0, 0.0))


def velocity(command: Command) -> tuple[float, float, float]:
    assert isinstance(command.setpoint, VelocitySetpoint)
    return command.setpoint.velocity_ned_m_s


def test_the_class_searches_until_it_sees_orange_and_flies_there_in_the_world() -> None:
    autonomy = built(speed_m_s=0.8)
    assert velocity(autonomy.act(telemetry(0.0, 1.0))) == (0.0, 0.0, 0.0)
    autonomy.perceive(image(1.0, column=160))
    north, east, _ = velocity(autonomy.act(telemetry(math.pi / 2, 1.1)))
    assert north == pytest.approx(0.0, abs=0.01)
    assert east == pytest.approx(0.8, abs=0.05)
    autonomy.perceive(image(1.2, column=240))
    command = autonomy.act(telemetry(0.0, 1.3))
    assert command.note == "approach"
    assert velocity(command)[1] > 0.2
    assert autonomy.act(telemetry(0.0, 2.3)).note == "search"


def test_the_class_is_done_once_it_has_flown_on_from_where_the_gate_filled_its_image() -> None:
    autonomy = built(speed_m_s=0.9)
    autonomy.perceive(image(1.0, column=160, rows=(0, 240)))
    flown = [autonomy.act(telemetry(0.0, t_s)) for t_s in (1.1, 3.0, 3.2)]
    assert [one.done for one in flown] == [False, False, True]
    assert {one.note for one in flown} == {"through"}


def test_the_figures_of_the_page_are_those_of_the_code() -> None:
    rate = AutonomyPart.model_fields["rate_hz"]
    limits = {name: value for one in rate.metadata for name, value in vars_of(one).items()}
    assert f"({limits['ge']:g} to {limits['le']:g}, {rate.default:g} by default)" in PAGE
    assert f"longer than {AutonomyLimits().call_s:g} s is a FAIL" in PAGE
    assert f"a constructor has {AutonomyLimits().build_s:g} s" in PAGE
    assert f"more than {autonomy_calls._LARGEST:g}".replace("1e+06", "1e6") in PAGE
    assert f"up to {autonomy_calls._LONGEST_NOTE} characters" in PAGE


def vars_of(constraint: object) -> dict[str, float]:
    found = {name: getattr(constraint, name, None) for name in ("ge", "le")}
    return {name: value for name, value in found.items() if value is not None}


def test_every_kind_of_reading_stands_on_the_page() -> None:
    kinds = [name for name in wil_campaign.api.__all__ if name.endswith("Reading")]
    missing = [name for name in kinds if not re.search(rf"\b{name}\b", PAGE)]
    assert missing == [], "docs/autonomy.md names each reading of wil_campaign.api"
