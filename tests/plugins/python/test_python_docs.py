"""The examples of docs/python.md run as they stand, against a campaign of brief flights."""

import asyncio
import re
import threading
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import wil_campaign
from tests.orchestrator.conftest import STEP, Fly
from tests.plugins.pytest.test_pytest_plugin import write_cases
from tests.plugins.search.searches import SEARCH, write_search
from tests.test_house import ROOT
from wil_campaign.plugins.python import flying
from wil_campaign.plugins.python.flight_messages import CampaignEnded, FlightRequest
from wil_campaign.plugins.python.flying import CannotFlyError
from wil_campaign.plugins.search import calls

PAGE = (ROOT / "docs" / "python.md").read_text("utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera}}
combine: [{sensor: camera, filter: [{isolate_color: orange}], merge: overlay}]
"""


def write_material(folder: Path, fly_run: Fly) -> None:
    """Write what the examples read: campaigns, two images and a recipe, a recorded run."""
    search = SEARCH.replace("steps: 3", "steps: 2").replace("sim: 3", "sim: 2")
    write_search(folder, search).rename(folder / "search.yaml")
    write_cases(folder).rename(folder / "campaign.yaml")
    (folder / "recipe.yaml").write_text(RECIPE)
    for name in ("photo.png", "render.png"):
        cv2.imwrite(str(folder / name), np.full((12, 16, 3), (0, 110, 230), np.uint8))
    _, flown = fly_run(sets=STEP)
    flown.rename(folder / "recorded")


def test_the_examples_of_the_page_run(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    fly_run: Fly,
) -> None:
    write_material(tmp_path, fly_run)
    monkeypatch.chdir(tmp_path)
    *examples, example_of_a_fixture, example_of_a_test = BLOCKS
    names: dict[str, object] = {}
    for text in examples:
        exec(compile(text, "docs/python.md", "exec"), names)  # noqa: S102 - our own page
    said = capsys.readouterr().out
    assert "good/sim/1" in said
    assert "good PASS" in said
    assert "PASS FAIL" in said  # judged by another limit
    assert "0 ['not worse'" in said  # compared with equal flights
    assert "confirmed altitude/twin {'height': " in said
    assert "A failure that a search found: altitude/twin" in said
    frames, away = names["frames"], names["away"]
    assert isinstance(frames, dict)
    assert isinstance(away, dict)
    assert frames["image_bgr"].shape == (len(frames["t_s"]), 120, 160, 3)
    assert away["camera_pose_q_wxyz"].shape == (len(away["t_s"]), 4)
    assert "camera_pose_q_wxyz" not in frames  # a mixture has no pose of its own
    assert "case,mode,rep,seed,verdict" in said
    assert len(list(tmp_path.glob("*/hover/*/report.html"))) == 2
    assert "mock_vehicle" in example_of_a_fixture  # run by test_mock_vehicle.py
    compile(example_of_a_test, "docs/python.md", "exec")


def test_the_page_names_all_that_programs_import() -> None:
    assert [name for name in wil_campaign.__all__ if not re.search(rf"\b{name}\b", PAGE)] == []
    assert all(hasattr(wil_campaign, name) for name in wil_campaign.__all__)


class FlightThatLandsWhenAsked(AbstractContextManager["FlightThatLandsWhenAsked"]):
    def __init__(self) -> None:
        self.stopped, self.stops = threading.Event(), 0

    def __exit__(self, *_: object) -> None:
        self.stopped.wait()

    def wait(self, on_result: object, on_message: object) -> CampaignEnded:
        self.stopped.wait()
        raise CannotFlyError("nothing flew", 130)

    def stop(self) -> None:
        self.stops += 1
        if self.stops == 2:
            self.stopped.set()


async def test_a_cancelled_flight_lands_first_however_often_it_is_cancelled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = asyncio.Event()
    flights: list[FlightThatLandsWhenAsked] = []

    def begin(request: FlightRequest) -> FlightThatLandsWhenAsked:
        flights.append(FlightThatLandsWhenAsked())
        begun.set()
        return flights[0]

    monkeypatch.setattr(flying, "FlightProcess", begin)
    campaign = wil_campaign.load(write_cases(tmp_path), cases=["good"])
    flight = asyncio.create_task(wil_campaign.run_async(campaign, out=tmp_path))
    async with asyncio.timeout(10):
        await begun.wait()
    flight.cancel()
    await asyncio.sleep(0.05)
    assert not flight.done()
    flight.cancel()
    with pytest.raises(asyncio.CancelledError) as caught:
        await flight
    assert str(caught.value.__cause__) == "nothing flew", "else asyncio logs that nobody asked"
    assert flights[0].stops == 2


def test_an_exception_of_the_program_lands_first(tmp_path: Path) -> None:
    campaign = wil_campaign.load(write_cases(tmp_path), cases=["good"], repetitions=4)

    def break_off(_: wil_campaign.RunResult) -> None:
        raise RuntimeError("of the program")

    with pytest.raises(RuntimeError, match="of the program"):
        wil_campaign.run(campaign, out=tmp_path / "out", jobs=1, on_result=break_off)
    (folder,) = (tmp_path / "out" / "hover").iterdir()
    results = wil_campaign.read_results(folder)
    assert results.runs[0].verdict == "PASS"
    assert results.summary.not_flown


def test_an_unknown_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(wil_campaign.CannotFlyError, match="no run 'good/sim/9'") as caught:
        wil_campaign.run(write_cases(tmp_path), runs=["good/sim/9"])
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("options", [{"clock": "fast"}, {"jobs": "many"}])
def test_an_option_that_cannot_be_is_refused_before_a_process_starts(
    options: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of both modules: one that was imported now would keep it.
    for module in (flying, calls):
        monkeypatch.setattr(module, "FlightProcess", lambda *_: pytest.fail("started"))
    name, value = next(iter(options.items()))
    with pytest.raises(ValueError, match=f"{name}='{value}': should be"):
        wil_campaign.run(write_cases(tmp_path), **options)
    with pytest.raises(ValueError, match=f"{name}='{value}': should be"):
        wil_campaign.search(write_search(tmp_path), **options)
    whole = wil_campaign.FlightOptions(**options)
    with pytest.raises(ValueError, match=f"{name}='{value}': should be"):
        wil_campaign.run(write_cases(tmp_path), whole)


def test_validate_returns_problems_and_raises_nothing(tmp_path: Path) -> None:
    path = write_cases(tmp_path)
    assert wil_campaign.validate(path) == ()
    (problem,) = wil_campaign.validate(path, overrides={"repetitions": 0})
    assert "greater" in problem.message or "at least" in problem.message
    (missing,) = wil_campaign.validate(tmp_path / "none.yaml")
    assert "cannot be read" in missing.message


def test_a_folder_without_a_campaign_is_refused(tmp_path: Path) -> None:
    with pytest.raises(wil_campaign.ResultsFolderError):
        wil_campaign.read_results(tmp_path)
