"""Progress displays of `run` and `search`: silent, a line per run, or live on a terminal."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.table import Table
from rich.text import Text

from wil_campaign.orchestrator.campaign.display_thread import DisplayThread, ProgressDisplay
from wil_campaign.orchestrator.cli.standard_streams import ignore_broken_pipe
from wil_campaign.orchestrator.operator.run_messages import RunProgressReport
from wil_campaign.orchestrator.run_results.run_result import RunResult

VERDICT_STYLES = {
    "PASS": "green",
    "FAIL": "bold red",
    "INVALID": "bold yellow",
    "ERROR": "bold magenta",
    "ABORTED": "bold cyan",
}


class SilentDisplay:
    """A progress display that shows nothing: for --json, whose output is one document."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def progress(self, progress: RunProgressReport) -> None:
        """Display no progress."""

    def finished(self, result: RunResult) -> None:
        """Display no verdict."""

    def say(self, text: str) -> None:
        """Display no message."""

    def settle(self) -> None:
        """Wait for nothing: a call ends when all is displayed."""


@dataclass(slots=True)
class LineDisplay(SilentDisplay):
    """A progress display of one line per finished run: for logs and pipes."""

    console: Console
    total: int
    done: int = field(default=0, init=False)

    def finished(self, result: RunResult) -> None:
        """Print the verdict of a finished run."""
        self.done += 1
        self.console.print(Text(f"[{self.done}/{self.total}] ") + finished_line(result))

    def say(self, text: str) -> None:
        """Print a message on a line."""
        self.console.print(Text(text))


class TerminalDisplay(SilentDisplay):
    """A progress display on a terminal: runs in flight beneath the verdicts so far."""

    def __init__(self, *, console: Console, total: int) -> None:
        self._console = console
        self._flying: dict[tuple[str, str, int], RunProgressReport] = {}
        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=console,
        )
        self._task = self._bar.add_task("runs", total=total)
        self._live = Live(console=console, refresh_per_second=8, get_renderable=self._draw)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._flying.clear()
        self._live.stop()

    def progress(self, progress: RunProgressReport) -> None:
        """Display the progress of a run in flight."""
        self._flying[progress.case, progress.mode, progress.repetition] = progress

    def finished(self, result: RunResult) -> None:
        """Move a run from those in flight to the verdicts above."""
        self._flying.pop((result.case, result.mode, result.rep), None)
        self._bar.advance(self._task)
        self._live.console.print(finished_line(result))

    def say(self, text: str) -> None:
        """Print a message above the runs in flight."""
        self._live.console.print(Text(text))

    def _draw(self) -> RenderableType:
        table = Table.grid(padding=(0, 2))
        for key in sorted(self._flying):
            table.add_row(*_flying_cells(self._flying[key]))
        return Group(table, self._bar)


def progress_display_of(*, json: bool, total: int) -> ProgressDisplay:
    """Return the progress display of a command's output. total: runs to fly."""
    if json:
        return SilentDisplay()
    if ignore_broken_pipe().isatty():
        return DisplayThread(TerminalDisplay(console=plain_console(), total=total))
    return DisplayThread(LineDisplay(console=plain_console(soft_wrap=True), total=total))


def plain_console(*, width: int | None = None, soft_wrap: bool = False) -> Console:
    """Return a console on standard output that prints every text as it is.

    Messages, names and folders may have brackets and colons: they are no markup and no emoji.
    width: in columns; None for that of the terminal. soft_wrap: the terminal wraps long lines.
    """
    return Console(
        file=ignore_broken_pipe(),
        width=width,
        markup=False,
        emoji=False,
        highlight=False,
        soft_wrap=soft_wrap,
    )


def _flying_cells(progress: RunProgressReport) -> Iterable[RenderableType]:
    """Yield the table cells of a run in flight for the progress display."""
    yield f"{progress.case} {progress.mode} #{progress.repetition}"
    yield Text(progress.stage, style="blue")
    yield f"{progress.t_s:6.1f} s"
    yield "" if progress.mixing_rate_hz is None else f"mixing {progress.mixing_rate_hz:.0f} Hz"
    yield "" if progress.skew_ms is None else f"skew {progress.skew_ms:.1f} ms"
    yield "" if progress.clearance_m is None else f"clearance {progress.clearance_m:.2f} m"
    so_far = progress.verdict_so_far
    yield Text(so_far or "", style=VERDICT_STYLES.get(so_far or "", ""))


def finished_line(result: RunResult) -> Text:
    """Return the line of a finished run: what it was, its verdict, and why."""
    name = f"{result.case} {result.mode}"
    line = Text(f"{name}  " if result.control is not None else f"{name} #{result.rep}  ")
    line.append(f"{result.verdict:<7}", style=VERDICT_STYLES.get(result.verdict, ""))
    if result.control is not None:
        met = result.control.met
        note = " (control, as required)" if met else " (control, NOT as required)"
        line.append(note, style="dim" if met else "bold red")
    elif not result.required:
        line.append(" (reported)", style="dim")
    if result.attempts:
        line.append(f" (attempt {len(result.attempts) + 1})", style="yellow")
    if result.reason:
        line.append(f"  {result.reason}")
    if result.doubt:
        line.append(f"; {result.doubt}", style="yellow")
    return line
