"""Results of earlier versions are read as they were written."""

import json
from pathlib import Path

import pytest

from wil_campaign.orchestrator.run_results.result_reader import ResultError, read_result

EARLIER = sorted((Path(__file__).parent / "earlier").glob("*.json"))


@pytest.mark.parametrize("path", EARLIER, ids=lambda path: str(path.stem))
def test_a_result_of_an_earlier_version_is_read(path: Path) -> None:
    result = read_result(path)
    assert (result.verdict, result.decided_by) == ("FAIL", "reached/real")
    assert len(result.evidence) == len(json.loads(path.read_text())["evidence"]) > 0


@pytest.mark.parametrize("name", ["oracles", "evidence"])
def test_what_every_version_writes_must_not_be_missing(tmp_path: Path, name: str) -> None:
    document = json.loads(EARLIER[0].read_text())
    del document[name]
    path = tmp_path / "result.json"
    path.write_text(json.dumps(document, indent=2) + "\n")
    with pytest.raises(ResultError):
        read_result(path)


def test_a_flipped_byte_is_named_by_its_place(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_bytes(b'{"case": "l\xe1rge"}')
    with pytest.raises(ResultError, match=r"result\.json is damaged: it is not UTF-8 at byte 11$"):
        read_result(path)
