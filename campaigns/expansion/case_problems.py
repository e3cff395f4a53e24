"""Problems of the cases of a campaign: those of some cases alone say of which; pure."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from wil_campaign.foundation.files.documents import Problem

_MOST = 2


def problems_with_cases(
    found: Mapping[str, Iterable[Problem]], cases: Collection[str]
) -> list[Problem]:
    """Return problems by case or control, each once; with the names of the cases that it has.

    cases: all of the campaign, without its controls. A problem of all of them is the campaign's
    own, and one in a line that names its case needs no more.
    """
    having: dict[Problem, list[str]] = {}
    for name, problems in found.items():
        for problem in dict.fromkeys(problems):
            having.setdefault(problem, []).append(name)
    return [_named(problem, names, cases) for problem, names in having.items()]


def _named(problem: Problem, names: list[str], cases: Collection[str]) -> Problem:
    of_cases = [name for name in names if name in cases]
    if len(of_cases) == len(cases) or any(name in problem.source_line for name in names):
        return problem
    word = "case" if of_cases else "control"
    listed = of_cases or names
    text = ", ".join(listed[:_MOST])
    if len(listed) > 1:
        word += "s"
    if len(listed) > _MOST:
        text += f" and {len(listed) - _MOST} more"
    return replace(problem, message=f"{word} {text}: {problem.message}")
