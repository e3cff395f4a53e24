"""The verdict table at the end of a campaign, and the lines beneath it."""

import re
import shlex
from collections.abc import Callable, Iterable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from wil_campaign.campaigns.values.acceptance import PassRequirement, RequirementStanding
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.orchestrator.cli.external_lines import external_lines
from wil_campaign.orchestrator.cli.progress_display import VERDICT_STYLES
from wil_campaign.orchestrator.cli.text_table import count_text
from wil_campaign.orchestrator.run_results.acceptance_texts import (
    left_out_names,
    required_text,
    row_verdict,
    shortfall_texts,
)
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.caveats import (
    campaign_caveats,
    caveats_in_short,
    retried_texts,
    synthesised_texts,
)
from wil_campaign.orchestrator.run_results.exit_codes import standings_of
from wil_campaign.orchestrator.run_results.run_result import Percentiles, RunResult
from wil_campaign.safety.model.verdict import event_source_of
from wil_campaign.safety.oracles.registry import oracle_kinds

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

LAST_LINE = 120
"""Letters of the last line at most; what is longer stands above it."""
MORE_ABOVE = "more above"
"""How many parts of the conclusion the last line leaves to the lines before it."""
_LOGS = ("-node.log", "-autonomy.log")
"""What a ROS 2 node and a program printed, among the files of a run."""
_OF_OFFSET = frozenset({"reached", "reached_position"})
_ALWAYS = "_always"
"""How the names of oracles end that judge whatever the campaign says."""
_MOST_RETRIED = 3
"""How many runs that took several attempts the last line names; the lines above have all."""


def verdict_table(summary: Summary, requirements: Sequence[PassRequirement]) -> Table:
    """Return the table of verdicts by case and mode; 80 columns wide for short names."""
    title = f"{summary.campaign}: {count_text(len(summary.runs), 'run')}"
    if summary.controls:
        title += f", {count_text(len(summary.controls), 'control')}"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in _COLUMNS:
        words = name in {"case", "mode", "verdict"}
        table.add_column(name, justify="left" if words else "right", no_wrap=True)
    standings = {
        (standing.requirement.case, standing.requirement.mode): standing
        for standing in standings_of(summary.runs, requirements)
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
    # A FAIL that another oracle decided would read as one that must not fail.
    wrong = "must not" if run.verdict == "PASS" else "not as required"
    text = f"{run.verdict} ({'control' if met else wrong})"
    return (passed, Text(text, style="green" if met else "bold red"), *rest)


def conclusion_lines(
    summary: Summary,
    requirements: Sequence[PassRequirement] = (),
    *,
    announced: AbstractSet[str] = frozenset(),
) -> list[Text]:
    """Return the lines beneath the verdict table: why runs did not pass, and the conclusion.

    Caveats come right before the last line, and in it. announced: names of runs whose reason stands
    above already.
    """
    unmet = list(summary.unmet)
    for run in summary.controls:
        if _name(run) in announced:
            unmet = [text.replace(f" ({run.bare_reason})", "") for text in unmet]
    summary = replace(summary, unmet=tuple(unmet))
    return [*_reasons(summary, announced), *closing_lines(summary, requirements)]


def closing_lines(
    summary: Summary,
    requirements: Sequence[PassRequirement] = (),
    *,
    changed_since_flight: Sequence[str] = (),
) -> list[Text]:
    """Return the closing lines of the verdict table: caveats, what decided, the conclusion.

    changed_since_flight: options and files that differ from those of the flight.
    """
    outside = [Text(line, style="dim") for line in external_lines(summary.runs)]
    lines = [*campaign_caveats(summary.runs), *synthesised_texts(summary), *summary.caveats]
    if summary.not_flown:
        lines.append(f"never flown: {', '.join(summary.not_flown)}")
    caveat_lines = [Text(line, style="yellow") for line in lines]
    short = shortfall_texts(summary.runs, requirements) if summary.accepted is False else ()
    decided = [Text(f"{required_text(summary, requirements)}: {'; '.join(short)}", style="red")]
    return [
        *outside,
        *caveat_lines,
        *(decided if short else ()),
        *_conclusion(summary, changed_since_flight),
    ]


def _cells(
    runs: Sequence[RunResult], standing: RequirementStanding | None
) -> Sequence[RenderableType]:
    passed = sum(run.verdict == "PASS" for run in runs)
    return (
        f"{passed}/{len(runs)}",
        _verdict(runs, standing),
        _metres(_known(run.clearance_m for run in runs), min),
        _metres(_offsets_m(runs), max),
        _largest_ms([run.sync.takeoff_skew_s for run in runs]),
        *_mixing_cells(runs),
    )


def _verdict(runs: Sequence[RunResult], standing: RequirementStanding | None) -> Text:
    """Return a row's verdict, with the required share where it is not all, or the tested rates.

    A PASS for which runs were flown again has a star, and how many attempts one took at most; the
    lines beneath name those runs.
    """
    if standing is None:
        return Text("reported", style="dim")
    word = row_verdict(standing, runs)
    share, test = standing.requirement.share, standing.requirement.test
    wanted = "" if share.passes == share.runs else f" ({share})"
    if test is not None:
        wanted = f" ({test.at_least:g}:{test.against:g})"
    if word == "PASS" and (most := max(len(run.attempts) for run in runs)):
        return Text(f"PASS*{wanted}, {most + 1} attempts", style="yellow")
    return Text(f"{word}{wanted}", style=VERDICT_STYLES.get(word, "yellow"))


def _offsets_m(runs: Sequence[RunResult]) -> list[float]:
    """Return the judged vehicle's offsets in gates, or from the goal, of a row's runs."""
    return _known(
        oracle.actual
        for run in runs
        for oracle in run.oracles
        if oracle.name in _OF_OFFSET and oracle.vehicle == run.subject
    )


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _metres(values_m: list[float], worst: Callable[[list[float]], float]) -> str:
    return f"{worst(values_m):.2f}" if values_m else "-"


def _largest_ms(values: Sequence[float | None]) -> str:
    """Return the largest of a row's times in milliseconds."""
    known = _known(values)
    return f"{max(map(abs, known)) * 1000:.0f}" if known else "-"


def _mixing_cells(runs: Sequence[RunResult]) -> tuple[str, str]:
    """Return the verdict table's cells of mixing: rate and registration error."""
    mixed = [run.mixing for run in runs if run.mixing is not None]
    if not mixed:
        return "-", "-"
    errors = [mixing_result.registration_error_px for mixing_result in mixed]
    bounds = [mixing_result.registration_bound_px for mixing_result in mixed]
    rate = f"{min(mixing_result.rate_hz for mixing_result in mixed):.1f}"
    if (largest := _largest_median(errors)) is not None:
        return rate, f"{largest:.1f}"
    within = _largest_median(bounds)
    return rate, "-" if within is None else f"<{within:.1f}"


def _largest_median(figures: Sequence[Percentiles | None]) -> float | None:
    """Return the largest median of a row's figures; None without one."""
    medians = [each.p50 for each in figures if each is not None and each.p50 is not None]
    return max(medians, default=None)


def _reasons(summary: Summary, announced: AbstractSet[str]) -> list[Text]:
    """Return the lines of runs without a clean PASS, but of those that were announced."""
    lines = [
        f"{run.case} {run.mode} #{run.rep} {run.verdict}: {_why(run)}"
        for run in summary.runs
        if (run.verdict != "PASS" or run.attempts) and _name(run) not in announced
    ]
    lines += [
        f"control {run.case} {run.mode} {run.verdict}, as required: {_why(run)}"
        for run in summary.controls
        if run.control is not None and run.control.met and _name(run) not in announced
    ]
    return [Text(line, style="dim") for line in lines]


def _name(run: RunResult) -> str:
    return f"{run.case}/{run.mode}/{run.rep}"


def _why(run: RunResult) -> str:
    return "; ".join(text for text in (run.reason, run.doubt) if text)


def explained_words(summary: Summary) -> list[Text]:
    """Return a line for each word of the verdict table that a newcomer may not know."""
    runs = (*summary.runs, *summary.controls)
    found = {
        "reported: flown and judged, but not required by `accept`": any(
            not run.required and run.control is None for run in runs
        ),
        "control: a run that must not pass; it shows that the campaign can fail": any(
            run.control is not None for run in runs
        ),
        "INVALID: the flight proves nothing, neither for nor against": any(
            run.verdict == "INVALID" for run in runs
        ),
        "left out: required by the campaign, but not selected on the command line": bool(
            summary.left_out
        ),
    }
    return [Text(line, style="dim") for line, is_shown in found.items() if is_shown]


def next_steps(
    summary: Summary, *, flown: Sequence[str], clock: Clock | None, folder: Path, has_report: bool
) -> list[Text]:
    """Return what a person may do next, as lines.

    flown: the campaign's file, and the options that chose its runs; clock: as given; folder: of the
    results.
    """
    file, *choice = flown
    steps = []
    command = ("wil-campaign", "run", *flown, *(() if clock is None else ("--clock", clock)))
    if summary.broken:
        anew = "flies the campaign anew: after an internal exception no --resume is accepted"
        steps.append(f"next: {shlex.join(command)} {anew}")
    elif summary.not_flown or summary.stopped is not None:
        line = shlex.join((*command, "--out", str(folder), "--resume"))
        steps.append(f"next: {line} flies what is missing")
    broken = [
        run for run in summary.runs if run.decided_by in {"autonomy", f"autonomy/{run.subject}"}
    ]
    logs = [name for run in broken for name in run.artifacts if name.endswith(_LOGS)]
    if logs:
        log = shlex.quote(str(folder / logs[0]))
        steps.append(f"next: {log} has all that the autonomy printed")
    if any(_hangs_on_limits(run) for run in summary.runs):
        line = shlex.join(("wil-campaign", "judge", file, str(folder), *choice))
        steps.append(f"next: {line} tries other limits without flying")
    if has_report:
        steps.append("next: open the report in a browser; it begins with what decided")
    return [Text(line, style="dim") for line in steps]


def _hangs_on_limits(run: RunResult) -> bool:
    """Return whether a run FAILed by nothing but limits, so that it passes by others."""
    failed = [one for one in run.oracles if one.required and one.verdict == "FAIL"]
    by_oracle = {event_source_of(one.name, one.vehicle) for one in failed}
    if run.verdict != "FAIL" or run.decided_by not in by_oracle:
        return False
    kinds = oracle_kinds()
    names = (one.name.removesuffix(_ALWAYS) for one in failed)
    # One of another name is the campaign's own, as a formula.
    return all(name not in kinds or kinds[name].has_limit for name in names)


def _planned_count(summary: Summary) -> int:
    """Return how many runs and controls the campaign should have flown."""
    return len(summary.runs) + len(summary.controls) + len(summary.not_flown)


def _conclusion(summary: Summary, changed_since_flight: Sequence[str]) -> list[Text]:
    """Return the verdict table's last line, accepted or not; before it what does not fit there."""
    words = {True: ("accepted", "bold green"), False: ("not accepted", "bold red")}
    text, style = words.get(summary.accepted or False, ("", ""))
    if summary.accepted is None:
        text, style = "nothing required was flown", "yellow"
    elif summary.left_out and summary.accepted:
        text += " of what was flown"
    parts = []
    if again := retried_texts(summary.runs):
        more = f"; and {len(again) - _MOST_RETRIED} more" if len(again) > _MOST_RETRIED else ""
        named = "; ".join(again[:_MOST_RETRIED])
        parts.append(f"{len(again)} not at the first attempt ({named}{more})")
    parts += caveats_in_short(summary)
    if summary.accepted and (count := len(summary.caveats)):
        parts.append(f"{count} {'caveat' if count == 1 else 'caveats'}")
    style = "yellow" if parts else style
    if summary.not_flown:
        parts.append(f"never flown: {len(summary.not_flown)} of {_planned_count(summary)}")
    if summary.left_out:
        style = "yellow" if summary.accepted else style
        parts.append(f"required but left out: {left_out_names(summary)}")
    if summary.ending:
        style = "yellow" if summary.accepted is not False else style
        parts.append(summary.ending)
    if changed_since_flight:
        style = "yellow" if summary.accepted else style
        named = ", ".join(changed_since_flight)
        parts.append(f"judged by other options or files than flown: {named}")
    if summary.unmet:
        style = "bold red"
        parts += summary.unmet
    note = " (the embedded surrogate played the real vehicle)" if summary.surrogate else ""
    kept = _fitting(text, parts, LAST_LINE - len(note))
    last = Text("; ".join([text, *kept]), style=style).append(note, style="dim")
    return [*(Text(part, style=style) for part in parts if part not in kept), last]


def _fitting(text: str, parts: Sequence[str], most: int) -> list[str]:
    """Return the parts for a line of so many letters: whole, else in short, else only counted."""
    kept: list[str] = []
    for index, part in enumerate(parts):
        later = [_head(one) for one in parts[index + 1 :]]
        fits = len("; ".join([text, *kept, part, *later])) <= most
        kept.append(part if fits else _head(part))
    while kept and len("; ".join([text, *kept])) > most:
        kept = [*kept[: -2 if kept[-1].endswith(MORE_ABOVE) else -1]]
        kept.append(f"{len(parts) - len(kept)} {MORE_ABOVE}")
    return kept


def _head(part: str) -> str:
    """Return what a part of the last line begins with, before its details."""
    return re.split(r": | \(|, but ", part, maxsplit=1)[0]
