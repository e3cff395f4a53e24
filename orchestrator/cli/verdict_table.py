"""The verdict table at the end of a campaign, and the lines beneath it."""

from collections.abc import Sequence
from collections.abc import Set as AbstractSet

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from campaigns.values.acceptance import Requirement, Standing
from orchestrator.cli.external_lines import external_lines
from orchestrator.cli.progress_display import VERDICT_STYLES
from orchestrator.cli.text_table import count_text
from orchestrator.model.acceptance_texts import required_text, row_verdict, shortfall_texts
from orchestrator.model.campaign_results import Summary
from orchestrator.model.caveats import caveats, in_short, synthesised_texts
from orchestrator.model.exit_codes import standings_of
from orchestrator.model.results import Percentiles, RunResult
from safety.evaluation.judge import COLLISION_ALWAYS

_COLUMNS = (
    "case",
    "mode",
    "passed",
    "verdict",
    "clearance\nm",
    "offset\nm",
    "skew\nms",
    "mixing\nHz",
    "error\npx",
)
"""The worst of all runs of a row: clearance, offset in the gate, takeoff skew, mixing rate, and
the largest median of the registration error."""


def verdict_table(summary: Summary, requirements: Sequence[Requirement]) -> Table:
    """Return the table of verdicts by case and mode; 80 columns wide for short names."""
    title = f"{summary.campaign}: {count_text(len(summary.runs), 'run')}"
    if summary.controls:
        title += f", {count_text(len(summary.controls), 'control')}"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in _COLUMNS:
        words = name in {"case", "mode", "verdict"}
        table.add_column(name, justify="left" if words else "right", no_wrap=True)
    standings = {
        (one.requirement.case, one.requirement.mode): one
        for one in standings_of(summary.runs, requirements)
    }
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for run in summary.runs:
        groups.setdefault((run.case, run.mode), []).append(run)
    for (case, mode), runs in groups.items():
        table.add_row(case, mode, *_cells(runs, standings.get((case, mode))))
    if summary.controls:
        table.add_section()
    for control in summary.controls:
        table.add_row(control.case, control.mode, *_control_cells(control))
    return table


def _control_cells(run: RunResult) -> Sequence[RenderableType]:
    """Return the verdict table's cells of a control; green where it ended as expected."""
    passed, _, *rest = _cells([run], None)
    met = run.control is not None and run.control.met
    text = f"{run.verdict} (control)" if met else f"{run.verdict} (must not)"
    return (passed, Text(text, style="green" if met else "bold red"), *rest)


def conclusions(summary: Summary, requirements: Sequence[Requirement] = ()) -> list[Text]:
    """Return the lines beneath the verdict table: why runs did not pass, and the conclusion.

    Caveats come right before the last line, and in it.
    """
    return [*_reasons(summary), *closing_lines(summary, requirements)]


def closing_lines(
    summary: Summary,
    requirements: Sequence[Requirement] = (),
    *,
    changed_since_flight: Sequence[str] = (),
) -> list[Text]:
    """Return the closing lines of the verdict table: caveats, what decided, the conclusion.

    changed_since_flight: options and files that differ from those of the flight.
    """
    outside = [Text(line, style="dim") for line in external_lines(summary.runs)]
    lines = [*caveats(summary.runs), *synthesised_texts(summary), *summary.caveats]
    if summary.not_flown:
        lines.append(f"never flown: {', '.join(summary.not_flown)}")
    caveat_lines = [Text(line, style="yellow") for line in lines]
    short = shortfall_texts(summary.runs, requirements) if summary.accepted is False else ()
    decided = [Text(f"{required_text(summary.runs)}: {'; '.join(short)}", style="red")]
    return [
        *outside,
        *caveat_lines,
        *(decided if short else ()),
        _conclusion(summary, changed_since_flight),
    ]


def _cells(runs: Sequence[RunResult], standing: Standing | None) -> Sequence[RenderableType]:
    """Return the verdict table's cells of a case and mode."""
    passed = sum(run.verdict == "PASS" for run in runs)
    return (
        f"{passed}/{len(runs)}",
        _verdict(runs, standing),
        _worst(runs, {"collision", COLLISION_ALWAYS.name}),
        _worst(runs, {"reached"}, largest=True),
        _largest_ms([run.sync.takeoff_skew_s for run in runs]),
        *_mixing_cells(runs),
    )


def _verdict(runs: Sequence[RunResult], standing: Standing | None) -> Text:
    """Return a row's verdict, with the required share where it is not all, or the tested rates.

    A PASS for which runs were flown again has a star; the lines beneath name those runs.
    """
    if standing is None:
        return Text("reported", style="dim")
    word = row_verdict(standing, runs)
    share, test = standing.requirement.share, standing.requirement.test
    wanted = "" if share.passes == share.runs else f" ({share})"
    if test is not None:
        wanted = f" ({test.at_least:g}:{test.against:g})"
    if word == "PASS" and any(run.attempts for run in runs):
        return Text(f"PASS*{wanted}", style="yellow")
    return Text(f"{word}{wanted}", style=VERDICT_STYLES.get(word, "yellow"))


def _worst(runs: Sequence[RunResult], names: AbstractSet[str], *, largest: bool = False) -> str:
    """Return the worst value of the judged vehicle in these oracles over a row's runs."""
    values = [
        oracle.actual
        for run in runs
        for oracle in run.oracles
        if oracle.name in names and oracle.vehicle == run.subject and oracle.actual is not None
    ]
    if not values:
        return "-"
    return f"{max(values) if largest else min(values):.2f}"


def _largest_ms(values: Sequence[float | None]) -> str:
    """Return the largest of a row's times in milliseconds."""
    known = [abs(value) for value in values if value is not None]
    return f"{max(known) * 1000:.0f}" if known else "-"


def _mixing_cells(runs: Sequence[RunResult]) -> tuple[str, str]:
    """Return the verdict table's cells of mixing: rate and registration error."""
    mixed = [run.mixing for run in runs if run.mixing is not None]
    if not mixed:
        return "-", "-"
    errors = [one.registration_error_px for one in mixed]
    bounds = [one.registration_bound_px for one in mixed]
    rate = f"{min(one.rate_hz for one in mixed):.1f}"
    if (largest := _largest_median(errors)) is not None:
        return rate, f"{largest:.1f}"
    within = _largest_median(bounds)
    return rate, "-" if within is None else f"<{within:.1f}"


def _largest_median(figures: Sequence[Percentiles | None]) -> float | None:
    """Return the largest median of a row's figures; None without one."""
    medians = [each.p50 for each in figures if each is not None and each.p50 is not None]
    return max(medians, default=None)


def _reasons(summary: Summary) -> list[Text]:
    """Return the lines of runs without a clean PASS for the verdict table."""
    lines = [
        Text(f"{run.case} {run.mode} #{run.rep} {run.verdict}: {run.reason}", style="dim")
        for run in summary.runs
        if run.verdict != "PASS" or run.attempts
    ]
    lines += [
        Text(f"control {run.case} {run.mode} {run.verdict}, as it must: {run.reason}", style="dim")
        for run in summary.controls
        if run.control is not None and run.control.met
    ]
    return lines + [Text(text, style="bold red") for text in summary.unmet]


def _planned_count(summary: Summary) -> int:
    """Return how many runs and controls the campaign should have flown."""
    return len(summary.runs) + len(summary.controls) + len(summary.not_flown)


def _conclusion(summary: Summary, changed_since_flight: Sequence[str]) -> Text:
    """Return the verdict table's last line: accepted or not."""
    words = {True: ("accepted", "bold green"), False: ("not accepted", "bold red")}
    text, style = words.get(summary.accepted or False, ("", ""))
    if summary.accepted is None:
        text, style = "nothing required was flown", "yellow"
    elif summary.left_out:
        text += " of what was flown"
    if summary.totals.retried:
        text, style = f"{text}; {summary.totals.retried} not at the first attempt", "yellow"
    for caveat in in_short(summary):
        text, style = f"{text}; {caveat}", "yellow"
    if summary.not_flown:
        text += f"; never flown: {len(summary.not_flown)} of {_planned_count(summary)}"
    if summary.left_out:
        style = "yellow" if summary.accepted else style
        text += f"; required, and left out: {', '.join(summary.left_out)}"
    if summary.ending:
        style = "yellow" if summary.accepted is not False else style
        text += f"; {summary.ending}"
    if changed_since_flight:
        style = "yellow" if summary.accepted else style
        text += f"; judged by other options or files than flown: {', '.join(changed_since_flight)}"
    if summary.unmet:
        text, style = f"{text}: {'; '.join(summary.unmet)}", "bold red"
    note = " (the embedded surrogate played the real vehicle)" if summary.surrogate else ""
    return Text(text, style=style).append(note, style="dim")
