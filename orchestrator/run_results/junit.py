"""Writes junit.xml for CI systems: each run is a test case.

FAIL is a failure; ERROR, INVALID and ABORTED are errors. A run that does not count against the
campaign (reported only, or a FAIL that its share forgives) is `skipped` with its reason as message:
visible, and the suite stays green. Required runs that were not flown are an error; so is whatever
else prevents acceptance: an internal exception, an operator's stop, controls that were not flown.
With required runs the suite is green exactly if the campaign is accepted, without them exactly if
the exit code is 5.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from wil_campaign.campaigns.values.acceptance import PassRequirement, RequirementStanding
from wil_campaign.orchestrator.run_results.attempts import attempt_text
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.caveats import (
    campaign_caveats,
    drawn_texts,
    dropped_out_texts,
    fence_texts,
    overridden_texts,
    reported_texts,
    retried_texts,
    synthesised_texts,
    unjudged_texts,
    unmeasured_texts,
    unshown_texts,
)
from wil_campaign.orchestrator.run_results.control_results import control_faults
from wil_campaign.orchestrator.run_results.exit_codes import is_rehearsed, standings_of
from wil_campaign.orchestrator.run_results.run_result import NOT_ARMED, RunResult
from wil_campaign.safety.model.oracle_results import OracleResult


def junit_xml(
    summary: Summary, requirements: Sequence[PassRequirement], *, arm: bool = True
) -> bytes:
    """Return a campaign's JUnit document. Times are seconds of the run clock, not of the wall.

    arm: False for --no-arm, where a run that did not come to arming is an error.
    """
    standings = standings_of(summary.runs, requirements)
    met = {(s.requirement.case, s.requirement.mode) for s in standings if s.met}
    cases = [
        _case(summary.campaign, run, (run.case, run.mode) in met, arm=arm) for run in summary.runs
    ]
    cases += [
        _missing_case(summary.campaign, standing)
        for standing in standings
        if not standing.is_complete
    ]
    cases += [_control(summary.campaign, run) for run in summary.controls]
    is_cut = summary.accepted is None and bool(summary.ending or summary.not_flown)
    if (summary.accepted is False or is_cut) and not any(map(_is_red, cases)):
        cases.append(_unaccepted_case(summary))
    root = ET.Element("testsuites")
    suite = ET.SubElement(root, "testsuite", name=_clean(summary.campaign))
    properties = {
        "left_out": summary.left_out,
        "controls_unmet": summary.unmet,
        "never_flown": summary.not_flown,
        "retried": retried_texts(summary.runs),
        "overridden": overridden_texts(summary.runs),
        "fence_changed": fence_texts(summary.runs),
        "reported_failed": reported_texts(summary.runs),
        "not_judged": unjudged_texts(summary.runs),
        "mixture_not_measured": unmeasured_texts(summary.runs),
        "simulator_not_compared": drawn_texts(summary.runs),
        "mixture_without": unshown_texts(summary.runs),
        "twin_dropped_out": dropped_out_texts(summary.runs),
    }
    named = {text for texts in properties.values() for text in texts}
    others = (
        line for line in campaign_caveats(summary.runs) if line.partition(": ")[2] not in named
    )
    properties["caveats"] = (*summary.caveats, *synthesised_texts(summary), *others)
    if any(properties.values()):
        parent = ET.SubElement(suite, "properties")
        for name, texts in properties.items():
            if texts:
                value = _clean(", ".join(texts))
                ET.SubElement(parent, "property", name=name, value=value)
    suite.extend(cases)
    for name, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(name, str(sum(case.find(tag) is not None for case in cases)))
    suite.set("tests", str(len(cases)))
    flown = (*summary.runs, *summary.controls)
    suite.set("time", _seconds(sum(run.duration_s or 0.0 for run in flown)))
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _case(campaign: str, run: RunResult, met: bool, *, arm: bool) -> ET.Element:
    """Return a run as a JUnit test case. met: its requirement is; arm: as of `junit_xml`."""
    case = ET.Element(
        "testcase",
        classname=_clean(f"{campaign}.{run.case}.{run.mode}"),
        name=_name(run),
        time=_seconds(run.duration_s or 0.0),
    )
    text = f"{run.verdict}: {run.reason}" if run.reason else run.verdict
    stopped = run.verdict == "ABORTED" or not arm
    if run.exceptions or (stopped and not is_rehearsed(run)):
        # No share forgives it, and the exit code counts it whether or not the run is required.
        message = "; ".join([run.reason, *_unmentioned_errors(run)])
        ET.SubElement(case, "error", message=_clean(message), type=run.verdict)
    elif run.verdict != "PASS":
        if not run.required:
            ET.SubElement(case, "skipped", message=_clean(f"reported only: {text}"))
        elif run.verdict == "FAIL" and met:
            ET.SubElement(case, "skipped", message=_clean(f"within what is accepted: {text}"))
        else:
            tag = "failure" if run.verdict == "FAIL" else "error"
            ET.SubElement(case, tag, message=_clean(run.reason), type=run.verdict)
    _write_out(case, run)
    return case


def _unmentioned_errors(run: RunResult) -> list[str]:
    """Return the internal exceptions and later errors of a run that its reason does not mention."""
    later_errors = [
        also.reason for also in run.also if also.verdict == "ERROR" and run.reason == NOT_ARMED
    ]
    errors = dict.fromkeys((*run.exceptions, *later_errors))
    return [text for text in errors if text not in run.reason]


def _is_red(case: ET.Element) -> bool:
    return any(case.find(tag) is not None for tag in ("failure", "error"))


def _control(campaign: str, run: RunResult) -> ET.Element:
    """Return a control as a JUnit test case, which succeeds when it ended as expected."""
    classname = _clean(f"{campaign}.controls.{run.case}.{run.mode}")
    seconds = _seconds(run.duration_s or 0.0)
    case = ET.Element("testcase", classname=classname, name=_name(run), time=seconds)
    if faults := [*control_faults([run]), *run.exceptions]:
        is_error = run.exceptions or run.verdict in {"ERROR", "INVALID", "ABORTED"}
        tag = "error" if is_error else "failure"
        ET.SubElement(case, tag, message=_clean("; ".join(faults)), type=run.verdict)
    _write_out(case, run, f"{run.verdict}, a control that must not pass: {run.reason}")
    return case


def _write_out(case: ET.Element, run: RunResult, *first: str) -> None:
    """Add a run's oracles and attempts to its JUnit test case as output."""
    lines = [*first, *(_line(oracle) for oracle in run.oracles)]
    lines += [f"also {late.verdict} at {late.at_s:.3f} s: {late.reason}" for late in run.also]
    lines += [
        f"earlier attempt: {attempt_text(attempt)}, in {attempt.folder}" for attempt in run.attempts
    ]
    ET.SubElement(case, "system-out").text = _clean("\n".join([f"seed {run.seed}", *lines]))


def _name(run: RunResult) -> str:
    """Return a run's JUnit name; with the attempt of a retried one, as CI shows only the name."""
    return f"{run.rep} (attempt {len(run.attempts) + 1})" if run.attempts else str(run.rep)


def _missing_case(campaign: str, standing: RequirementStanding) -> ET.Element:
    """Return a JUnit test case for required runs that were not flown."""
    wanted = standing.requirement
    classname = _clean(f"{campaign}.{wanted.case}.{wanted.mode}")
    case = ET.Element("testcase", classname=classname, name="not flown", time="0.000")
    ET.SubElement(case, "error", message=_clean(str(standing)), type="NOT_FLOWN")
    return case


def _unaccepted_case(summary: Summary) -> ET.Element:
    """Return a JUnit test case for a campaign that is not accepted though no run failed."""
    missing = f"never flown: {', '.join(summary.not_flown)}" if summary.not_flown else ""
    known = [text for text in (missing, summary.ending) if text]
    why = "; ".join(known) or "an internal exception occurred; see the run's log.jsonl"
    case = ET.Element("testcase", classname=_clean(summary.campaign), name="accepted", time="0.000")
    message = _clean(f"the campaign is not accepted; {why}")
    ET.SubElement(case, "error", message=message, type="NOT_ACCEPTED")
    return case


def _line(oracle: OracleResult) -> str:
    parts = [f"{oracle.verdict} {oracle.name} ({oracle.vehicle})"]
    if oracle.actual is not None:
        parts.append(f"actual {oracle.actual:.4g} {oracle.unit}".rstrip())
    if oracle.margin is not None:
        parts.append(f"margin {oracle.margin:.4g} {oracle.unit}".rstrip())
    if not oracle.required:
        parts.append("reported only")
    return ", ".join(parts + ([oracle.detail] if oracle.detail else []))


def _seconds(value: float) -> str:
    return f"{value:.3f}"


_NOT_OF_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot hold."""


def _clean(text: str) -> str:
    """Return a text without the characters that XML 1.0 (JUnit) cannot hold."""
    return _NOT_OF_XML.sub("?", text)
