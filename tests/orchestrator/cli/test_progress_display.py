"""Progress displays print names and messages as they are, and keep no one who calls them."""

import contextlib
import io
import os
import sys
import termios
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

import pytest
from rich.console import Console
from rich.table import Table

from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from wil_campaign.orchestrator.cli.progress_display import (
    LineDisplay,
    TerminalDisplay,
    plain_console,
    progress_display_of,
)
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

TEXTS = (
    "  [/talker] stopped",
    "[INFO] [169.2] [talker]: hi",
    "[bold]not bold[/]",
    ":smile: [link=x]y[/link]",
)


@pytest.mark.parametrize("text", TEXTS)
def test_a_message_is_printed_as_it_is(text: str) -> None:
    lines = io.StringIO()
    LineDisplay(console=Console(file=lines), total=1).say(text)
    assert lines.getvalue() == f"{text}\n"
    terminal = io.StringIO()
    with TerminalDisplay(console=Console(file=terminal, width=80), total=1) as display:
        display.say(text)
    assert text in terminal.getvalue()


@pytest.mark.parametrize("text", TEXTS)
def test_the_console_of_the_commands_prints_cells_titles_and_lines_as_they_are(
    capsys: pytest.CaptureFixture[str], text: str
) -> None:
    table = Table(title=text, title_justify="left")
    table.add_column("name")
    table.add_row(text)
    console = plain_console(soft_wrap=True)
    assert console.measure(table).maximum > len(text)
    console.print(f"results: {text}")
    plain_console(width=80).print(table)
    assert capsys.readouterr().out.count(text) == 3


@dataclass
class Output:
    """A terminal or a pipe as standard output, which can be stopped."""

    reader: int
    writer: TextIO
    shown: bytearray = field(default_factory=bytearray)

    def __post_init__(self) -> None:
        self._reading = threading.Thread(target=self._read, daemon=True)

    def stop(self) -> None:
        """Take nothing more: a terminal as by Ctrl-S, a pipe as one that is full."""
        if self.writer.isatty():
            termios.tcflow(self.writer, termios.TCOOFF)
            return
        os.set_blocking(self.writer.fileno(), False)
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(self.writer.fileno(), b".")
        os.set_blocking(self.writer.fileno(), True)

    def release(self) -> None:
        if self.writer.isatty():
            termios.tcflow(self.writer, termios.TCOON)
        self._reading.start()

    def text(self) -> str:
        """Close the output, and return what was written to it."""
        self.writer.close()
        self._reading.join(60.0)
        return self.shown.decode()

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # the terminal's end
            while data := os.read(self.reader, 65536):
                self.shown += data


@pytest.fixture(params=[os.openpty, os.pipe])
def output(request: pytest.FixtureRequest) -> Iterator[Output]:
    reader, writer = request.param()
    with os.fdopen(writer, "w") as stream:
        yield Output(reader, stream)
    os.close(reader)


def test_an_output_that_takes_nothing_keeps_no_abort(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output: Output
) -> None:
    """The campaign's loop shows what it does: Ctrl-S, or a frozen ssh, must not stop it."""
    monkeypatch.setattr(sys, "stdout", output.writer)
    fleet = FakeFleet()
    with progress_display_of(json=False, total=2) as display:
        controller = make_controller(tmp_path, fleet, say=display.say)
        output.stop()

        def obey_both() -> None:
            controller.obey(OperatorCommand("hold", "anna"))
            controller.obey(OperatorCommand("abort", "ben"))

        obeying = threading.Thread(target=obey_both, daemon=True)
        obeying.start()
        obeying.join(30.0)
        aborted = list(fleet.aborted)
        output.release()
    shown = output.text()
    assert [one.who for one in aborted] == ["ben"]
    assert 0 < shown.index("hold by anna: held: 1 run") < shown.index("abort by ben: all vehicles")
