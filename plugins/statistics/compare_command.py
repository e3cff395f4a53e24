"""`wil-campaign compare`: whether a case became worse since earlier flights."""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from wil_campaign.foundation.files.document_writer import HTML, require_own_file, write_atomically
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.cli.markdown import markdown_table, markdown_text
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.cli.text_table import count_text, table_lines
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.recording.timestamps import utc_text
from wil_campaign.plugins.statistics.comparison.baseline import FlownSet
from wil_campaign.plugins.statistics.comparison.comparison_page import (
    LinkedFolder,
    render_comparison,
)
from wil_campaign.plugins.statistics.comparison.errors import ComparisonError
from wil_campaign.plugins.statistics.comparison.folder_comparison import FolderComparison
from wil_campaign.plugins.statistics.comparison.folder_comparison import compare as compare_folders
from wil_campaign.plugins.statistics.inference.probability_text import p_text
from wil_campaign.plugins.statistics.report_links import REPORT, link_from

_HEAD = ("case", "mode", "what", "before", "after", "flights", "p", "")
_Share = Annotated[float, Parameter(validator=Number(gt=0.0, lt=1.0))]


def compare(
    before: Path,
    after: Path,
    *,
    worse_by: Annotated[float, Parameter(validator=Number(gte=0.0, lte=1.0))] = 0.1,
    margin_by: Annotated[float | None, Parameter(validator=Number(gt=0.0))] = None,
    confidence: _Share = 0.95,
    last: Annotated[int, Parameter(validator=Number(gte=1))] = 5,
    removed: Annotated[bool, Parameter(negative=())] = False,
    changed: Annotated[bool, Parameter(negative=())] = False,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
    markdown: Annotated[bool, Parameter(negative=())] = False,
    page: Path | None = None,
) -> int:
    """Compare two campaigns: exit code 1 when a case became worse beyond chance and size.

    2: a folder has no campaign, or the campaigns share no case and mode. 3: something is damaged;
    the judged campaign was stopped, failed outside of its runs, or does not record its end; a
    control of it did not end as expected, so that its passes show nothing; a shared case, or a
    larger share of its flights than before, proves nothing; a case lost more than the limit, and
    cannot be tested as the flights of one side are equal, or too few to show any loss; AFTER lacks
    a case, an oracle or a control of BEFORE and --removed is not given; or it was flown with other
    limits, worlds, files or another firmware and --changed is not given.

    Parameters
    ----------
    before
        The results folder of a campaign, or a folder of several: then the last flights of the
        campaign of AFTER that started before it are the baseline together.
    after
        The results folder of the campaign that is judged.
    worse_by
        The loss of pass rate that matters, from 0 to 1.
    margin_by
        The loss of an oracle's mean margin that matters, in its unit; without it margins are not
        compared.
    confidence
        The confidence, of all tests together, that a reported loss is not chance.
    last
        How many results folders the baseline has, where `before` holds several.
    removed
        Accept that cases, oracles and controls of BEFORE are missing in AFTER.
    changed
        Accept that AFTER was flown with other limits, worlds, files, options or firmware than
        BEFORE. What differs is named either way; the autonomy, code, versions of this program and
        parameters in the vehicle never count.
    json_
        Print one JSON document.
    markdown
        Print Markdown, as a comment in a pull request.
    page
        Write one HTML page here: intervals, changed settings, links to the reports.
    """
    if json_ and markdown:
        write_stderr("--json and --markdown are two forms of one output: give one of them")
        return 2
    require_own_file(page, HTML)
    try:
        compared = compare_folders(
            before,
            after,
            worse_by=worse_by,
            margin_by=margin_by,
            confidence=confidence,
            last=last,
        )
    except (ResultsFolderError, ComparisonError) as error:
        write_stderr(printable_problem(str(error)))
        return 2
    code = compared.exit_code(removed=removed, changed=changed)
    sentences, doubts = _sentences(compared, code), _doubts(compared, removed, changed)
    try:
        if page is not None:
            html = _as_page(compared, page, sentences, doubts, after=after)
            write_atomically(page, html)
    except OSError as error:
        write_stderr(f"{page} cannot be written: {error.strerror or error}")
        return 3
    if json_:
        write_stdout(_as_json(compared, doubts))
    elif markdown:
        write_stdout(_as_markdown(compared, sentences, doubts, after=after))
    else:
        write_stdout(_as_text(compared, sentences, after=after))
    for text in doubts:
        write_stderr(printable_problem(text))
    return code


def _doubts(compared: FolderComparison, removed: bool, changed: bool) -> list[str]:
    """Return what is missing, differs, is damaged or was not caught by a control."""
    found = []
    if compared.is_less and not removed:
        found.append(
            "AFTER lacks cases, oracles, controls or settings of BEFORE; give --removed if that is "
            "intended"
        )
    if compared.settings.changed and not changed:
        found.append(
            "AFTER was flown with other settings than BEFORE; give --changed if that is intended"
        )
    return [*found, *compared.problems]


def _as_text(compared: FolderComparison, sentences: Sequence[str], *, after: Path) -> str:
    """Return the comparison as a table and sentences."""
    head = f"{after.name} against {_names(compared.baseline)}"
    below = "\n".join(map(printable_problem, sentences))
    return f"{printable_problem(head)}\n\n{table_lines(_HEAD, _rows(compared))}\n\n{below}"


def _as_markdown(
    compared: FolderComparison, sentences: Sequence[str], doubts: Sequence[str], *, after: Path
) -> str:
    """Return the comparison as Markdown: the conclusion, the table, the rest as a list.

    doubts: first of the list, since nobody sees standard error beside a comment.
    """
    *rest, last = sentences
    lines = [*doubts, *rest]
    against = f"{after.name} against {_names(compared.baseline)}"
    parts = [f"### {markdown_text(last)}", markdown_text(against)]
    parts += [markdown_table(_HEAD, _rows(compared))]
    parts += ["\n".join(f"- {markdown_text(line)}" for line in lines)] if lines else []
    return "\n\n".join(parts)


def _as_page(
    compared: FolderComparison,
    page: Path,
    sentences: Sequence[str],
    doubts: Sequence[str],
    *,
    after: Path,
) -> str:
    """Return the comparison as HTML, with links from the page to the reports."""
    *others, last = sentences
    of_settings = ("not set any more: ", "other settings: ", "also changed: ")

    def linked(folder: Path) -> LinkedFolder:
        report = folder / REPORT
        name = folder.absolute().name
        return LinkedFolder(name, link_from(page, report) if report.is_file() else "")

    return render_comparison(
        compared.found.changes,
        compared.settings,
        level=compared.level,
        conclusion=last,
        sentences=[
            *doubts,
            *(sentence for sentence in others if not sentence.startswith(of_settings)),
        ],
        before=[linked(path) for path in compared.baseline.folders],
        after=linked(after),
        made_utc=utc_text(time.time()),
    )


def _names(baseline: FlownSet) -> str:
    """Return the names of the folders of the baseline."""
    return ", ".join(baseline.names)


def _rows(compared: FolderComparison) -> list[tuple[str, ...]]:
    """Return the cells of the table of changes."""
    return [
        (
            change.case,
            change.mode,
            change.what,
            _figure_text(change.before, change.unit, is_beyond=change.is_beyond[0]),
            _figure_text(change.after, change.unit, is_beyond=change.is_beyond[1]),
            f"{change.flights[0]} and {change.flights[1]}",
            "-" if change.p is None else p_text(change.p, compared.level),
            f"{change.outcome}{f': {change.why}' if change.why else ''}",
        )
        for change in compared.found.changes
    ]


def _sentences(compared: FolderComparison, code: int) -> list[str]:
    """Return what is to say beside the table; the last one is the conclusion.

    code: the exit code; 3 proves nothing, whatever the table has.
    """
    found, settings = compared.found, compared.settings
    lines = [f"same seed, other verdict: {text}" for text in found.flips]
    lines += [f"proves nothing in one of them: {cell}" for cell in found.unproven]
    lines += [f"more flights that prove nothing: {text}" for text in found.fewer_proven]
    lines += [f"more attempts that proved nothing (retries): {text}" for text in found.flown_again]
    lines += [f"not flown any more: {cell}" for cell in found.only_before]
    lines += [f"not judged any more: {text}" for text in found.removed_oracles]
    lines += [f"control not flown any more: {text}" for text in compared.removed_controls]
    lines += [f"not set any more: {text}" for text in settings.removed]
    lines += [f"other settings: {text}" for text in settings.changed]
    lines += [f"also changed: {text}" for text in settings.named]
    lines += [f"not flown before: {cell}" for cell in found.only_after]
    worse = [f"{change.case}/{change.mode} {change.what}" for change in found.worse]
    untested = found.untestable
    undecided = sum(change.outcome == "undecided" for change in found.changes) - len(untested)
    last = f"worse: {', '.join(worse)}" if worse else "nothing became worse beyond chance and size"
    if found.flips:
        # First, since under the virtual clock it is no chance.
        changed = f"{len(found.flips)} of {count_text(found.equal_seeds, 'run')} of equal seed"
        last = f"{changed} changed the verdict; {last}"
    elif found.equal_seeds:
        kept = count_text(found.equal_seeds, "run")
        last += f"; {kept} of equal seed kept the verdict"
    if undecided:
        last += f"; {undecided} lost more than the limit, which may be chance: fly more"
    if untested:
        why = {"too few flights" if one.p is not None else "equal flights" for one in untested}
        last += f"; {len(untested)} lost more than the limit and cannot be tested: "
        last += " or ".join(sorted(why))
    return [*lines, f"this comparison proves nothing; {last}" if code == 3 else last]


def _figure_text(value: float, unit: str, *, is_beyond: bool) -> str:
    """Return a figure with its unit; is_beyond: it is larger than the value."""
    return f"{'> ' if is_beyond else ''}{value:.3g} {unit}".rstrip()


def _as_json(compared: FolderComparison, doubts: Sequence[str]) -> str:
    """Return the comparison as JSON."""
    document = {
        "schema": "wil/comparison/1",
        "baseline": [str(folder) for folder in compared.baseline.folders],
        **asdict(compared.found),
        "removed_controls": list(compared.removed_controls),
        "settings": asdict(compared.settings),
        "problems": list(doubts),
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
