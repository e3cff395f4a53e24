"""Progress displays print messages and names as they are: brackets and colons are no markup."""

import io

import pytest
from rich.console import Console
from rich.table import Table

from orchestrator.cli.progress_display import LineDisplay, TerminalDisplay, plain_console

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
