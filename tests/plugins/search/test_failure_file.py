"""The campaign file of a confirmed failure: what it names it names from its own folder."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.plugins.search.searches import SEARCH, write_search
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.plugins.search.exploration.model import FailingCase, SearchVariant
from wil_campaign.plugins.search.exploration.search_file import load_search
from wil_campaign.plugins.search.exploration.space import Values
from wil_campaign.plugins.search.search_runner import failure_text

CHOICES = """\
    where: {key: world, choices: [world.yaml, worlds/other.yaml]}
    who: {key: autonomy, choices: ['still.py:Still', 'others/still.py:Still']}
  objective:"""


def failure_of(path: Path, values: Values, *sets: str, **more: Any) -> tuple[str, Campaign]:
    """Write the file of a failure into another folder; return its text, and what it loads as."""
    case = FailingCase(
        variant=SearchVariant(name="v0001", values=values),
        mode="sim",
        standing="confirmed",
        cause="altitude/twin",
        failed=2,
        proven=2,
        interval=None,
        reduced=SearchVariant(name="v0001-r01", values=values, of="v0001"),
        reduced_failed=2,
        reduced_proven=2,
        **more,
    )
    folder = path.parent / "out" / "failures"
    folder.mkdir(parents=True)
    file = folder / "v0001.yaml"
    file.write_text(failure_text(load_search(path, ExpansionOptions(sets=sets)), case, folder))
    return file.read_text(), load_campaign(file)


def test_files_that_a_parameter_chooses_are_named_from_the_new_folder(tmp_path: Path) -> None:
    path = write_search(tmp_path, SEARCH.replace("  objective:", CHOICES))
    for folder, name in (("worlds", "world.yaml"), ("others", "still.py")):
        (tmp_path / folder).mkdir()
        text = (tmp_path / name).read_text()
        (tmp_path / folder / name.replace("world.yaml", "other.yaml")).write_text(text)
    chosen: Values = {"where": "worlds/other.yaml", "who": "others/still.py:Still", "height": 1.4}
    text, campaign = failure_of(path, chosen)
    (overrides,) = yaml.safe_load(text)["cases"].values()
    assert overrides == {
        "goal.altitude_m": 1.4,
        "world": "../../worlds/other.yaml",
        "autonomy": "../../others/still.py:Still",
    }
    assert (tmp_path / "worlds" / "other.yaml") in [one.resolve() for one in campaign.paths]


@pytest.mark.parametrize(
    ("link", "autopilot", "launched"),
    [
        ("{launch: ardupilot, binary: sitl/bin/arducopter}", "ardupilot", "sitl/bin/arducopter"),
        ("{launch: px4, build: build/sitl}", "px4", "build/sitl"),
        ("{launch: px4, build: px4}", "px4", "px4"),
    ],
)
def test_programs_and_build_folders_are_named_from_the_new_folder(
    tmp_path: Path, link: str, autopilot: str, launched: str
) -> None:
    """A folder px4 is no `autopilot: px4`."""
    path = write_search(tmp_path)
    text = path.read_text().replace("link: embedded", f"link: {link}")
    path.write_text(text.replace("autopilot: px4", f"autopilot: {autopilot}"))
    for build in ("px4", "build/sitl"):
        _write_program(tmp_path / build / "bin" / "px4")
        (tmp_path / build / "etc" / "init.d-posix").mkdir(parents=True)
        (tmp_path / build / "etc" / "init.d-posix" / "rcS").touch()
    _write_program(tmp_path / "sitl" / "bin" / "arducopter")
    parameters = tmp_path / "sitl" / "Tools" / "autotest" / "default_params"
    parameters.mkdir(parents=True)
    (parameters / "copter.parm").touch()
    text, campaign = failure_of(path, {"height": 1.4})
    assert f"../../{launched}\n" in text
    assert f"autopilot: {autopilot}\n" in text
    assert campaign.cases == ("failure-v0001",)


def test_an_absolute_path_and_a_text_that_is_no_path_stay_as_they_are(tmp_path: Path) -> None:
    path = write_search(tmp_path)
    (tmp_path / "Still").mkdir()
    named = f"{tmp_path}/still.py:Still"
    parameters = "{mode: Still, share: 1/2, version: '1.0', topic: /}"
    text, _ = failure_of(path, {"height": 1.4}, f"autonomy={{use: {named}, with: {parameters}}}")
    assert yaml.safe_load(text)["autonomy"] == {
        "use": named,
        "with": {"mode": "Still", "share": "1/2", "version": "1.0", "topic": "/"},
    }


def test_its_comment_and_description_name_the_causes_with_their_numbers(tmp_path: Path) -> None:
    text, campaign = failure_of(
        write_search(tmp_path),
        {"height": 1.4},
        causes={"altitude/twin": 1, "collision/twin": 1},
        reduced_causes={"altitude/twin": 2},
    )
    assert text.startswith(
        "# Found by a search as v0001; failed in 2 of 2 flights in mode sim by altitude/twin.\n"
    )
    described = yaml.safe_load(text)["description"]
    assert described.endswith("found: altitude/twin 1, collision/twin 1")
    assert campaign.repetitions == 2


def _write_program(path: Path) -> None:
    path.parent.mkdir(parents=True)
    path.touch()
    path.chmod(0o755)
