"""The firmware that flew: in words, compared, and in results of earlier versions."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.reading.flown_campaign import Flight
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.run_results.result_parts import (
    FlownFirmware,
    distinct_firmware,
    firmware_changes,
)
from wil_campaign.orchestrator.run_results.result_reader import ResultError, read_result

BOARD = FlownFirmware(
    vehicle="real",
    autopilot="ardupilot",
    version="4.6.1",
    git_hash="8d3c51a7",
    board="vendor 1209, product 5741, board 90000",
    uid="0011223344",
    frame="quadrotor, FRAME_CLASS 1",
    parameters="0123456789abcdef",
)


def test_a_firmware_in_words() -> None:
    assert str(BOARD) == (
        "ardupilot 4.6.1 (8d3c51a7), vendor 1209, product 5741, board 90000, "
        "quadrotor, FRAME_CLASS 1, uid 0011223344, parameters 0123456789abcdef"
    )
    assert replace(BOARD, git_hash="00000000").release == "ardupilot 4.6.1"


def test_another_version_differs_from_another_unit() -> None:
    assert firmware_changes(BOARD, BOARD) == ("", "")
    kind, unit = firmware_changes(BOARD, replace(BOARD, version="4.6.2"))
    assert "was ardupilot 4.6.1" in kind
    assert "now it is ardupilot 4.6.2" in kind
    assert unit == ""
    kind, unit = firmware_changes(BOARD, replace(BOARD, uid="99", parameters="f"))
    assert kind == ""
    assert unit == (
        "real: the uid of its board was 0011223344, now it is 99; "
        "the digest of its parameters was 0123456789abcdef, now it is f"
    )


def test_unknown_parameters_and_the_uid_of_a_simulation_are_no_change() -> None:
    assert firmware_changes(BOARD, replace(BOARD, parameters="")) == ("", "")
    simulated = replace(BOARD, board="simulation")
    assert firmware_changes(simulated, replace(simulated, uid="99")) == ("", "")


def test_each_firmware_is_listed_once() -> None:
    twin = replace(BOARD, vehicle="twin")
    assert distinct_firmware([twin, BOARD, twin]) == (BOARD, twin)


def test_a_result_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    result = Flight(case="a", mode="wil", rep=1).result()
    document = json.loads(to_json(result))
    assert document.pop("firmware") == []
    path.write_text(to_json(document))
    assert read_result(path) == result
    document.pop("exceptions")
    path.write_text(to_json(document))
    with pytest.raises(ResultError, match="was edited, or written by another version"):
        read_result(path)


def test_the_firmware_of_a_result_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    result = Flight(case="a", mode="wil", rep=1, firmware=(BOARD,)).result()
    path.write_text(to_json(result))
    assert read_result(path).firmware == (BOARD,)
