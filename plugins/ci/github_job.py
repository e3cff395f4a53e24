"""What a job of GitHub Actions shows: annotations of files and runs, and a summary of the job.

Its workflow commands and limits: GitHub's pages "Workflow commands" and "Job summaries".
"""

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.foundation.files.problems import Problem
from wil_campaign.orchestrator.cli.markdown import markdown_table, markdown_text
from wil_campaign.orchestrator.cli.standard_streams import write_stderr
from wil_campaign.orchestrator.cli.verdict_table import MORE_ABOVE, conclusion_lines, verdict_table
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.junit import junit_xml
from wil_campaign.plugins.ci.repository_paths import repository_path

_SHOWN = 10
"""GitHub shows as many annotations of a kind of a step, and drops the rest."""
_LINES = 50
_LINE_LETTERS = 600
_REPORT = "report.html"
_MORE_BELOW = "more below"


def tell_problems(problems: tuple[Problem, ...], warnings: tuple[Problem, ...]) -> None:
    """Print an annotation for each fault of a file, and each warning."""
    if os.environ.get("GITHUB_ACTIONS") != "true":
        return
    for kind, found in (("error", problems), ("warning", warnings)):
        _annotate(kind, [(_place(problem), problem.text) for problem in found])


def tell_verdicts(campaign: Campaign, summary: Summary, folder: Path, *, arm: bool = True) -> None:
    """Print an annotation for each run that counts against the campaign; summarise the job."""
    if os.environ.get("GITHUB_ACTIONS") == "true":
        _annotate("error", list(_failures(campaign, summary, arm=arm)))
    if file := os.environ.get("GITHUB_STEP_SUMMARY"):
        try:
            with Path(file).open("a", encoding="utf-8", errors="backslashreplace") as stream:
                stream.write(summary_markdown(campaign, summary, folder))
        except OSError as error:
            write_stderr(f"GITHUB_STEP_SUMMARY: {file}: {error.strerror or error}")


def summary_markdown(campaign: Campaign, summary: Summary, folder: Path) -> str:
    """Return how a campaign ended as Markdown: conclusion, table, reasons, where the report is."""
    columns = verdict_table(summary, campaign.requirements).columns
    head = [str(column.header).replace("\n", " ") for column in columns]
    rows = zip(*(map(str, column.cells) for column in columns), strict=True)
    *lines, last = (line.plain for line in conclusion_lines(summary, campaign.requirements))
    listed = [f"- {_shortened(line)}" for line in lines[:_LINES]]
    if len(lines) > _LINES:
        listed.append(f"- and {len(lines) - _LINES} lines more in the job's log")
    last = last.replace(MORE_ABOVE, _MORE_BELOW)  # where the terminal ends, a page begins
    parts = [f"### {markdown_text(campaign.name)}: {_shortened(last)}"]
    parts += [markdown_table(head, [list(row) for row in rows]), "\n".join(listed), _where(folder)]
    return "\n\n".join(part for part in parts if part) + "\n\n"


def _where(folder: Path) -> str:
    """Return where the report is; "" without one. Pictures cannot be in a summary."""
    if not (folder / _REPORT).is_file():
        return ""
    known = [os.environ.get(name, "") for name in ("GITHUB_SERVER_URL", "GITHUB_REPOSITORY")]
    run = os.environ.get("GITHUB_RUN_ID", "")
    place = "the artifacts of this run"
    if all((*known, run)):
        place = f"[{place}]({'/'.join(known)}/actions/runs/{run}#artifacts)"
    return f"Pictures, maps and recordings: {markdown_text(str(folder / _REPORT))}, in {place}."


def _shortened(text: str) -> str:
    more = "..." if len(text) > _LINE_LETTERS else ""
    return markdown_text(text[:_LINE_LETTERS]) + more


def _failures(
    campaign: Campaign, summary: Summary, *, arm: bool
) -> Iterator[tuple[dict[str, str], str]]:
    """Yield place and text of what is a failure or an error in junit.xml."""
    root = ET.fromstring(junit_xml(summary, campaign.requirements, arm=arm))  # noqa: S314 - ours
    name = summary.campaign
    paths = {f"{name}.{run.case}.{run.mode}": ("cases", run.case) for run in summary.runs}
    paths |= {
        f"{name}.controls.{run.case}.{run.mode}": ("controls", run.case) for run in summary.controls
    }
    for case in root.iter("testcase"):
        red = case.find("failure")
        red = case.find("error") if red is None else red
        if red is None:
            continue
        path = paths.get(case.get("classname", ""), ())
        line, column = campaign.document.place(path, key=True)
        title = f"{case.get('classname')} {case.get('name')}: {red.get('type')}"
        place = _place(Problem(campaign.document.name, line, column, ""))
        yield {**place, "title": title}, red.get("message", "")


def _place(problem: Problem) -> dict[str, str]:
    """Return the properties of an annotation for a fault's place; none for what is no file."""
    path = repository_path(problem.file)
    if path is None:
        return {"title": problem.file}
    if not problem.line:
        return {"file": path}
    return {"file": path, "line": str(problem.line), "col": str(problem.column)}


def _annotate(kind: str, found: list[tuple[dict[str, str], str]]) -> None:
    """Print workflow commands, as many as GitHub shows; the last one says how many more."""
    shown = found if len(found) <= _SHOWN else found[: _SHOWN - 1]
    for place, text in shown:
        properties = ",".join(f"{name}={_property(value)}" for name, value in place.items())
        write_stderr(f"::{kind} {properties}::{_data(text)}")
    if more := len(found) - len(shown):
        write_stderr(f"::{kind} title=wil-campaign::and {more} more: see the log of this step")


def _data(text: str) -> str:
    """Return a text as the message of a workflow command."""
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    """Return a text as a property of a workflow command."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")
