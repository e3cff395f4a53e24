"""The preview of a world: a picture on disk and words about it, or faults with their places."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from wil_campaign.plugins.start.preview import main

HALL = Path(__file__).parents[3] / "worlds" / "hall.yaml"


def test_the_preview_writes_a_picture_and_names_the_things_in_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(HALL), str(tmp_path / "hall.png"), "--size", "320x180", "--north", "-1.6"]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "walker: " in said
    assert "0.1 x 1.2 x 1.2 m" in said
    first = cv2.imread(str(tmp_path / "hall.png"))
    assert first is not None
    assert first.shape == (180, 320, 3)
    assert main([*arguments, "--at", "3"]) == 0
    assert np.any(cv2.imread(str(tmp_path / "hall.png")) != first)
    assert main([*arguments, "--at", "3", "--event", "goal=3"]) == 0
    again = cv2.imread(str(tmp_path / "hall.png"))
    assert again is not None
    assert np.array_equal(again, first)


def test_a_thing_of_the_real_world_alone_shows_only_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(HALL), str(tmp_path / "hall.jpg"), "--size", "64x36", "--which", "W"]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "pallet: " in said
    assert "square gate" not in said


def test_faults_come_with_their_places(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text("schema: wil/world/1\norigin: {latitude_deg: 47, longitude: 8}\n", "utf-8")
    assert main([str(bad), str(tmp_path / "bad.png")]) == 2
    assert "bad.yaml:2:28: unknown key 'longitude'" in capsys.readouterr().err
    assert not (tmp_path / "bad.png").exists()


def test_a_picture_that_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(HALL), str(tmp_path / "none" / "p.png"), "--size", "16x9"]) == 3
    assert "No such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    "wrong",
    [
        ["p.gif"],
        ["p.png", "--size", "0x9"],
        ["p.png", "--size", "9"],
        ["p.png", "--event", "x"],
        ["p.png", "--event", "goal=nan"],
        ["p.png", "--fov", "0"],
        ["p.png", "--fov", "180"],
        ["p.png", "--fov", "5e-324"],
        ["p.png", "--fov", "nan"],  # it ended the process: no pixel is at NaN
        ["p.png", "--north", "inf"],
        ["p.png", "--at", "soon"],
    ],
)
def test_wrong_options_are_refused(wrong: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(HALL), *wrong])
    assert ended.value.code == 2
