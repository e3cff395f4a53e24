"""Files of mixtures: whole or not there, and never without a part that was mixed."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.mcap_runs import PROVENANCE
from tests.recipes.samples import camera
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.mixture_outputs import output_for_file
from wil_campaign.plugins.offline.offline_pairing import MixedPair
from wil_campaign.recipes.pipeline.mixture import MixedReading
from wil_campaign.vehicles.readings import Reading


def pair(reading: Reading) -> MixedPair:
    return MixedPair(camera(source="real"), None, MixedReading(reading, PROVENANCE))


def write(path: Path, readings: Iterable[Reading]) -> None:
    with output_for_file(path, rate_hz=30.0, epoch_s=0.0) as output:
        for reading in readings:
            output.receive("camera", pair(reading))


def failing() -> Iterator[Reading]:
    yield camera()
    raise KeyError


@pytest.mark.parametrize("name", ["mixed.mp4", "mixed.mcap"])
def test_a_file_is_replaced_once_the_new_one_is_whole(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"before")
    with pytest.raises(KeyError):
        write(path, failing())
    assert path.read_bytes() == b"before"
    write(path, [camera()])
    assert len(path.read_bytes()) > 100
    assert list(tmp_path.iterdir()) == [path]


def test_a_video_without_images_replaces_none(tmp_path: Path) -> None:
    path = tmp_path / "mixed.mp4"
    path.write_bytes(b"before")
    write(path, [])
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_mixture_that_cannot_be_recorded_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "mixed.mcap"
    bad: Any = replace(camera(), rendered=object())  # type: ignore[arg-type]  # no JSON
    with pytest.raises(OSError, match=r"mixed\.mcap: cannot be written: 1 of 2 of /twin/camera"):
        write(path, [camera(), bad])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["mixed.mp4", "mixed.mcap"])
def test_a_folder_that_is_missing_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(OfflineError, match=r"there is no folder .*nowhere; create it"):
        write(tmp_path / "nowhere" / name, [])
