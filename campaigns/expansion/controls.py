"""Controls of a campaign: what each changes, and how it must end."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial

from wil_campaign.campaigns.expansion.case_reader import collect_problems
from wil_campaign.campaigns.schema import CampaignPart, Mode
from wil_campaign.campaigns.schema.controls import ControlPart
from wil_campaign.campaigns.setup.case_files import CaseFiles, case_files
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.setup.overrides import Override, overrides_at, overrides_of_case
from wil_campaign.campaigns.values.expectation import Expectation
from wil_campaign.foundation.files.documents import Document, Problem, closest_word
from wil_campaign.safety.evaluation.judge import ALWAYS_JUDGED

_IN_ANY_REASON = frozenset(
    {"all", "and", "are", "for", "from", "has", "its", "more", "not", "than", "that", "the"}
    | {"was", "with", "real", "twin"}
)
"""Words that occur in the reasons of most runs, whatever happened."""
_WORD = re.compile(r"[^\W\d_]+")
_SHORTEST = 3
"""Least number of letters of a word by which a cause is recognised."""


def control_expectation(part: CampaignPart, control: ControlPart, setup: Case) -> Expectation:
    """Return the expected end of a control run, and the case that the control changes."""
    case = control.case or next(iter(part.cases))
    expect = control.expect
    return Expectation(case, expect.verdict, expect.oracle, _cause(expect.cause, setup))


def _cause(cause: str | None, setup: Case) -> str | None:
    """Return the text in a control's reason, with the pose sources that its vehicles have."""
    for name, vehicle in setup.vehicles.items() if cause is not None else ():
        cause = cause and cause.replace(f"{{{name}.pose_source}}", vehicle.pose_source)
    return cause


def modes_of_control(part: CampaignPart, control: ControlPart) -> tuple[Mode, ...]:
    """Return the modes in which a control is flown, in the campaign's order."""
    return tuple(mode for mode in part.modes if control.modes is None or mode in control.modes)


def files_of_controls(
    base: Document,
    part: CampaignPart | None,
    overrides: Iterable[Override],
    problems: list[Problem],
    complete: Callable[[Document], Document],
) -> dict[str, CaseFiles]:
    """Return the case files of every control, with what it changes.

    What a control sets wins over --set, which could otherwise undo the control. complete: see
    `case_files`.
    """
    found: dict[str, CaseFiles] = {}
    ordered = tuple(overrides)
    for name, control in ({} if part is None else part.controls).items():
        case = control.case or next(iter(part.cases if part is not None else ()))
        of_case = collect_problems(problems, partial(overrides_of_case, base, case)) or ()
        own = (
            collect_problems(problems, partial(overrides_at, base, ("controls", name, "set"))) or ()
        )
        found[name], wrong = case_files(base, (*of_case, *ordered, *own), complete)
        problems += wrong
    return found


def control_problems(
    base: Document, part: CampaignPart, setups: Mapping[str, Case]
) -> Iterator[Problem]:
    """Yield problems of the controls themselves: names, cases, modes, oracles."""
    for name, control in part.controls.items():
        path = ("controls", name)
        if name in part.cases:
            message = f"'{name}' is also a case; their results would share one folder"
            yield base.problem(path, message, key=True)
        if control.case is not None and control.case not in part.cases:
            message = f"there is no case '{control.case}'"
            yield base.problem((*path, "case"), message, closest_word(control.case, part.cases))
        for index, mode in enumerate(control.modes or ()):
            if mode not in part.modes:
                message = f"mode '{mode}' is not flown (modes: {', '.join(part.modes)})"
                yield base.problem((*path, "modes", index), message)
        oracle = control.expect.oracle
        if oracle is not None and name in setups:
            yield from _oracle_problems(base, name, oracle, setups[name])


def _oracle_problems(base: Document, name: str, oracle: str, case: Case) -> Iterator[Problem]:
    """Yield a control's expected oracle that the campaign lacks, or that cannot fail a run."""
    path = ("controls", name, "expect", "oracle")
    required = {use.name: use.parameters.required for use in case.oracles}
    if oracle in required and not required[oracle]:
        message = f"'{oracle}' is not required (required: false), so it cannot fail a run"
        yield base.problem(path, message)
    elif oracle not in required and oracle not in ALWAYS_JUDGED:
        known = (*required, *ALWAYS_JUDGED)
        message = f"no oracle '{oracle}' judges this control (there are {', '.join(known)})"
        yield base.problem(path, message, closest_word(oracle, known))


def control_warnings(base: Document, part: CampaignPart) -> Iterator[Problem]:
    """Yield warnings for controls that end as expected even if the campaign finds no failure."""
    for name, control in part.controls.items():
        oracle, cause = control.expect.oracle, control.expect.cause
        for key in control.set_:
            if oracle is not None and _changes_oracle(key, oracle):
                message = f"changes '{oracle}', which then fails by a limit of the control's own"
                path = ("controls", name, "set", key)
                yield base.problem(
                    path, f"{message}: the control proves nothing about it", key=True
                )
        if cause is not None and not _names_something(cause):
            message = f"'{cause}' is in the reason of nearly any run: give a more specific text"
            yield base.problem(("controls", name, "expect", "cause"), message)


def _changes_oracle(key: str, oracle: str) -> bool:
    """Return whether a dotted key of a control's `set` changes an oracle's parameters."""
    parts = key.split(".")
    if parts[0] == "oracles":
        return len(parts) == 1 or parts[1] == oracle
    return parts[0] == "geofence" == oracle


def _names_something(cause: str) -> bool:
    """Return whether a control's cause has a word that few reasons have."""
    words = _WORD.findall(cause.lower())
    return any(len(word) >= _SHORTEST and word not in _IN_ANY_REASON for word in words)
