"""The objects that the surrogate physically touches, in this process and in one of its own."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from tests.orchestrator.wall import CAMPAIGN, write_wall
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.run.vehicles.vehicle_backends import (
    InProcessBackend,
    SubprocessBackend,
)
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.vehicles.embedded.physics.config import ContactWorld
from wil_campaign.vehicles.embedded.physics.contact_world import from_argument
from wil_campaign.worlds.frames import Pose

PAD = """\
  pad:
    shape: {box: {size_m: [1, 1, 0.05]}}
    pose: {north_m: 0, east_m: 0, up_m: 0.025}
"""


def real_setup(folder: Path, **vehicle: object) -> RunSetup:
    """Return the setup of a real vehicle that stands on a pad of 5 cm, a wall ahead of it."""
    path = write_wall(folder)
    world = folder / "world.yaml"
    world.write_text(world.read_text() + PAD)
    given = {"link": "embedded", "autopilot": "ardupilot", "start": {"up_m": 0.05}, **vehicle}
    text = CAMPAIGN.replace("{twin: {link: embedded, autopilot: ardupilot}}", f"{{real: {given}}}")
    text = text.replace("modes: [sim]", "modes: [real]")
    path.write_text(text.replace("{landed: {}}", "{landed: {}, collision: {ground: [pad]}}"))
    plan = load_campaign(path, ExpansionOptions()).runs[0]
    return RunSetup.of(RunOrder(plan=plan, folder=folder, clock="virtual"))


def in_process(setup: RunSetup) -> ContactWorld:
    return InProcessBackend(setup, {})._contact_world()


def in_own_process(setup: RunSetup) -> ContactWorld:
    settings = SubprocessBackend(setup, cast("Any", None), {})._contact_settings()
    assert settings is not None
    return from_argument(settings.argument)


BOTH = pytest.mark.parametrize("world_of", [in_process, in_own_process])


def touched(world: ContactWorld, north_m: float, up_m: float) -> str | None:
    """Return what the vehicle touches that stands still at a place."""
    here = Pose.of(north_m, 0.0, up_m)
    return world.contact(here, 0.0, here, 0.02)


@BOTH
def test_the_surface_below_the_start_is_no_obstacle(
    tmp_path: Path, world_of: Callable[[RunSetup], ContactWorld]
) -> None:
    world = world_of(real_setup(tmp_path))
    assert touched(world, 0.0, 0.05) is None
    assert touched(world, 3.0, 1.0) == "wall.box"


@BOTH
@pytest.mark.parametrize(("width_m", "found"), [(0.3, None), (1.0, "wall.box")])
def test_it_touches_with_the_body_that_the_campaign_gives(
    tmp_path: Path,
    world_of: Callable[[RunSetup], ContactWorld],
    width_m: float,
    found: str | None,
) -> None:
    """The wall's face stands 0.35 m ahead: within half of 1 m, and beyond half of 0.3 m."""
    setup = real_setup(tmp_path, body={"width_m": width_m, "height_m": 0.1})
    assert touched(world_of(setup), 2.6, 1.2) == found
