"""Results are shared: no file of them, and nothing that is printed, has a password in it."""

import json
from pathlib import Path

import pytest

from tests.orchestrator.conftest import ROOT, workers_forked
from wil_campaign.foundation.files.problems import Problem, without_passwords
from wil_campaign.orchestrator.cli import main

SECRETS = ("s3cr3t", "t0ken")
ADDRESS = "rtsp://bob:s3cr3t@127.0.0.1:9/main?password=t0ken"
OPTIONS = (
    *("--case", "large", "--mode", "wil", "--repetitions", "1", "--clock", "wall", "--jobs", "1"),
    *("--set", "controls={}", "--set", f"vehicles.real.sensors.camera.source={ADDRESS}"),
)


@pytest.mark.usefixtures("fork_server")
def test_the_password_of_a_camera_is_in_no_file_of_the_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was in campaign.json, summary.json, report.html, junit.xml and run.mcap."""
    gate = str(ROOT / "campaigns" / "gate.yaml")
    with workers_forked():
        assert main(["run", gate, *OPTIONS, "--out", str(tmp_path)]) == 3
    printed = capsys.readouterr()
    shown = {"the terminal": (printed.out + printed.err).encode()}
    shown |= {str(path): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    found = [
        (name, secret)
        for name, text in shown.items()
        for secret in SECRETS
        if secret.encode() in text
    ]
    assert not found
    (folder,) = (tmp_path / "gate").iterdir()
    document = json.loads((folder / "campaign.json").read_text())["document"]
    shown_address = document["vehicles"]["real"]["sensors"]["camera"]["source"]
    assert shown_address == "rtsp://bob:***@127.0.0.1:9/main?password=***"
    # The same campaign is resumed and judged by its own file.
    with workers_forked():
        assert main(["run", gate, *OPTIONS, "--out", str(folder), "--resume"]) == 3
    assert "cannot be resumed" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("rtsp://bob:p@ss:w@cam/main, then", "rtsp://bob:***@cam/main, then"),
        ('{"a": "rtsps://:x@h", "b": "c@d"}', '{"a": "rtsps://:***@h", "b": "c@d"}'),
        ("rtsp://a:b@h,rtsp://c:d@i/e", "rtsp://a:***@h,rtsp://c:***@i/e"),
        ("rtsp://h:554/user=admin&password=x&n=1", "rtsp://h:554/user=admin&password=***&n=1"),
        ("'rtsp://bob:it's@cam/main': no", "'rtsp://bob:***@cam/main': no"),
        ("rtsp://bob:a/b/c@cam/main", "rtsp://bob:***@cam/main"),
        ('{"a": "rtsp://bob:q\\"r@cam/main"}', '{"a": "rtsp://bob:***@cam/main"}'),
        ("'rtsp://h/main?token=it's&n=1': no", "'rtsp://h/main?token=***&n=1': no"),
        ('{"a": "rtsp://h/main?token=q\\"r"}', '{"a": "rtsp://h/main?token=***"}'),
        ("'rtsp://h/main?token=abc': no", "'rtsp://h/main?token=***': no"),
        ("http://h:80/icon@2x.png", "http://h:80/icon@2x.png"),
        ("mqtt://h:1883 asks bob@site", "mqtt://h:1883 asks bob@site"),
        (
            "tcp://127.0.0.1:5555 and rtsp://bob@h/main",
            "tcp://127.0.0.1:5555 and rtsp://bob@h/main",
        ),
    ],
)
def test_an_address_is_shown_without_its_password(text: str, shown: str) -> None:
    assert without_passwords(text) == shown
    assert Problem("c.yaml", 3, 1, text, source_line=text).headline.endswith(shown)
    assert str(Problem("c.yaml", 3, 1, "no", source_line=text)).splitlines()[1].strip() == shown
