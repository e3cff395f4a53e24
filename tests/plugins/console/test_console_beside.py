"""The options of a console beside a flight: its address, and its certificate."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from wil_campaign.plugins.console.console_address import ConsoleError, ConsoleOptionError
from wil_campaign.plugins.console.console_beside import console_beside, server_options


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("auto", "--address 127.0.0.1"),
        (":8470", "--address :8470"),
        ("lab:8470,a.pem,a.key", "--address lab:8470 --tls-cert a.pem --tls-key a.key"),
        ("auto,a.pem,a.key", "--address 127.0.0.1 --tls-cert a.pem --tls-key a.key"),
    ],
)
def test_the_options_of_the_server(text: str, options: str) -> None:
    assert server_options(text) == tuple(options.split())


@pytest.mark.parametrize("text", ["auto,a.pem", "auto,,a.key", "auto,a.pem,", "auto,a,b,c"])
def test_a_certificate_and_its_key_go_together(text: str) -> None:
    with pytest.raises(ConsoleOptionError, match="give ADDRESS, or ADDRESS,CERTIFICATE,KEY"):
        server_options(text)
    assert ConsoleOptionError.code == 2


@pytest.mark.parametrize("text", ["lab:port", ":99999", "lab.example:8470", "0.0.0.0,a.pem,a.key"])
def test_an_address_of_no_use_is_refused_before_a_process_is_started(text: str) -> None:
    with pytest.raises(ConsoleOptionError):
        server_options(text)


def test_a_console_without_its_certificate_does_not_start(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text = f"auto,{tmp_path / 'none.pem'},{tmp_path / 'none.key'}"
    lines: list[str] = []
    with (
        pytest.raises(ConsoleError, match="nothing flies"),
        console_beside(text, lines.append, program=os.getpid()),
    ):
        pass
    assert lines == []
    assert "none.pem" in capfd.readouterr().err


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed here")
def test_a_console_with_its_certificate_serves_https(tmp_path: Path) -> None:
    subject = ("-subj", "/CN=127.0.0.1", "-days", "1", "-nodes", "-newkey", "rsa:2048")
    command = ["openssl", "req", "-x509", *subject, "-keyout", "a.key", "-out", "a.pem"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)  # noqa: S603
    lines: list[str] = []
    text = f"auto,{tmp_path / 'a.pem'},{tmp_path / 'a.key'}"
    with console_beside(text, lines.append, program=os.getpid()):
        assert len(lines) == 2
        assert all("https://127.0.0.1:" in line for line in lines)
