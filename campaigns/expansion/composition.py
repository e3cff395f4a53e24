"""Composition of several campaigns into one: their runs in one folder, cases named `part.case`.

A run of a part has the seed, the files and the requirement of the part's own file, and so flies
as it does there.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from wil_campaign.campaigns.expansion.case_reader import unique_problems
from wil_campaign.campaigns.expansion.omissions import set_option_caveats
from wil_campaign.campaigns.schema.composition import CompositionPart
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Problem,
    check_document,
    closest_word,
    load_document,
)
from wil_campaign.foundation.files.paths import is_file, is_folder
from wil_campaign.hooks import operator_channels
from wil_campaign.installed_plugins import plugin_additions

if TYPE_CHECKING:
    from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, RunPlan

    Load = Callable[[Path, ExpansionOptions], Campaign]


def is_composition(document: Document) -> bool:
    """Return whether a campaign file names other campaigns as its parts."""
    return document.get(("campaigns",)) is not None


def compose_campaigns(
    document: Document, options: "ExpansionOptions", load_part: "Load"
) -> "Campaign":
    """Return the campaign of a file that names others, expanded. Raises BadInput.

    load_part: expands one campaign file. Cases and controls are named `part.case`; options select
    them by these names, and otherwise apply to every part.
    """
    part = check_document(document, CompositionPart)
    problems: list[Problem] = []
    warnings: list[Problem] = []
    whole: dict[str, Campaign] = {}
    of_parts: dict[str, ExpansionOptions] = {}
    for name, file in part.campaigns.items():
        try:
            own = _part_document(document, name, file)
            of_parts[name] = _part_options(own, part, options)
            whole[name] = load_part(own.path, of_parts[name])
        except BadInput as error:
            problems += error.problems
            warnings += error.warnings
    if problems:
        raise BadInput(unique_problems(problems), unique_problems(warnings))
    _require_distinct(document, whole)
    _require_known(document, part, whole)
    chosen = _choose(whole, options.cases)
    parts, left_out = {}, []
    for name, campaign in whole.items():
        wanted = chosen[name]
        if not wanted:
            left_out.append(f"the campaign {name}")
        elif len(wanted) < len(_case_names(campaign)):
            path = document.path.parent / part.campaigns[name]
            parts[name] = load_part(path, replace(of_parts[name], cases=wanted))
        else:
            parts[name] = campaign
    _require_same(document, parts)
    return _merge(document, part, parts, left_out, options)


def _part_document(document: Document, name: str, file: str) -> Document:
    path = document.path.parent / file
    at = ("campaigns", name)
    if not is_file(path):
        others = [one.name for one in path.parent.glob("*.yaml")] if is_folder(path.parent) else []
        message = f"campaign file '{file}' does not exist"
        raise BadInput([document.problem(at, message, closest_word(file, others))])
    own = load_document(path)
    if is_composition(own):
        message = f"'{file}' is itself made of campaigns; list those here"
        raise BadInput([document.problem(at, message)])
    return own


def _part_options(
    own: Document, part: CompositionPart, options: "ExpansionOptions"
) -> "ExpansionOptions":
    """Return the options with which a part of a composition is loaded, with all its cases.

    The composition's modes are added to those of the part's own file, and alone selected.
    """
    sets: tuple[str, ...] = ()
    given = own.get(("modes",))
    if part.modes is not None and isinstance(given, list):
        modes = dict.fromkeys([*(str(mode) for mode in given), *part.modes])
        sets = (f"modes=[{', '.join(modes)}]",)
    return replace(
        options,
        cases=(),
        modes=options.modes or tuple(part.modes or ()),
        repetitions=part.repetitions if options.repetitions is None else options.repetitions,
        seed=part.seed if options.seed is None else options.seed,
        sets=(*sets, *options.sets),
        benches=() if own.get(("bench",)) is None else options.benches,
        composition=part,
    )


def _case_names(campaign: "Campaign") -> tuple[str, ...]:
    return (*campaign.cases, *dict.fromkeys(plan.case for plan in campaign.controls))


def _require_distinct(document: Document, parts: Mapping[str, "Campaign"]) -> None:
    """Raise BadInput where cases of two parts would share a name, and so a folder."""
    owners: dict[str, str] = {}
    for name, campaign in parts.items():
        for case in _case_names(campaign):
            full = f"{name}.{case}"
            if (other := owners.setdefault(full, name)) != name:
                message = f"'{name}' and '{other}' both have '{full}'; rename a part"
                raise BadInput([document.problem(("campaigns", name), message, key=True)])


def _require_known(
    document: Document, part: CompositionPart, parts: Mapping[str, "Campaign"]
) -> None:
    """Raise BadInput where published counts name a case that no part has."""
    known = [f"{name}.{case}" for name, campaign in parts.items() for case in campaign.cases]
    problems = [
        document.problem(
            ("published", "passed", case),
            f"published names an unknown case '{case}'",
            closest_word(case, known),
            key=True,
        )
        for case in (part.published.passed if part.published is not None else ())
        if case not in known
    ]
    if problems:
        raise BadInput(problems)


def _require_same(document: Document, parts: Mapping[str, "Campaign"]) -> None:
    """Raise BadInput where a part differs from the first in what a composition has only once."""
    first = next(iter(parts))
    problems = [
        document.problem(
            ("campaigns", name),
            f"'{name}' and '{first}' differ in {key}, which all parts of a composition share; make "
            f"it the same in both files, or run '{name}' alone",
        )
        for name, campaign in parts.items()
        for key, value in _once(campaign).items()
        if value != _once(parts[first])[key]
    ]
    if problems:
        raise BadInput(problems)


def _once(campaign: "Campaign") -> Mapping[str, object]:
    """Return what a campaign has once for all runs, by its name for users."""
    channels = {
        f"operator.{key}": campaign.operators.get(key)
        for key in plugin_additions(operator_channels)
    }
    test = {"the sequential test of repetitions": campaign.test}
    return {"between_runs": campaign.between} | channels | test


def _choose(
    parts: Mapping[str, "Campaign"], patterns: Iterable[str]
) -> Mapping[str, tuple[str, ...]]:
    """Return the names that patterns select of each part; all without one. Raises BadInput."""
    known = {name: _case_names(campaign) for name, campaign in parts.items()}
    given = tuple(patterns)
    full = [f"{name}.{case}" for name, cases in known.items() for case in cases]
    problems = [
        Problem(
            f"--case {pattern}",
            0,
            0,
            f"matches none of {', '.join(full)}",
            "",
            closest_word(pattern, full),
        )
        for pattern in given
        if not any(fnmatchcase(name, pattern) for name in full)
    ]
    if problems:
        raise BadInput(problems)
    return {
        name: tuple(
            case
            for case in cases
            if not given or any(fnmatchcase(f"{name}.{case}", pattern) for pattern in given)
        )
        for name, cases in known.items()
    }


def _merge(
    document: Document,
    part: CompositionPart,
    parts: Mapping[str, "Campaign"],
    left_out: list[str],
    options: "ExpansionOptions",
) -> "Campaign":
    """Return the campaigns as one, every case and control with its part's name before it."""
    first = next(iter(parts.values()))
    each = list(parts.items())
    controls = [plan for name, campaign in each for plan in _named(name, campaign.controls)]
    left = left_out + [f"{name}: {item}" for name, campaign in each for item in campaign.left_out]
    if not part.fly_controls:
        left += [f"the controls of {name} (fly_controls: false)" for name, one in each]
    return replace(
        first,
        name=part.campaign,
        description=part.description,
        document=document,
        paths=tuple(
            dict.fromkeys(
                [document.path, *(p for campaign in parts.values() for p in campaign.paths)]
            )
        ),
        cases=tuple(f"{name}.{case}" for name, campaign in each for case in campaign.cases),
        modes=tuple(dict.fromkeys(mode for campaign in parts.values() for mode in campaign.modes)),
        repetitions=max(campaign.repetitions for campaign in parts.values()),
        seed=first.seed if part.seed is None else part.seed,
        setups={
            f"{name}.{case}": s for name, campaign in each for case, s in campaign.setups.items()
        },
        runs=tuple(plan for name, campaign in each for plan in _named(name, campaign.runs)),
        requirements=tuple(
            replace(wanted, case=f"{name}.{wanted.case}")
            for name, campaign in each
            for wanted in campaign.requirements
        ),
        left_out=tuple(left),
        controls=tuple(controls) if part.fly_controls else (),
        warnings=unique_problems(
            [warning for campaign in parts.values() for warning in campaign.warnings]
        ),
        caveats=(
            *dict.fromkeys(
                f"{name}: {caveat}" for name, campaign in each for caveat in campaign.caveats
            ),
            *set_option_caveats(options.sets, None),
        ),
        options=options,
        benches=tuple(
            {bench.name: bench for part in parts.values() for bench in part.benches}.values()
        ),
    )


def _named(name: str, plans: Iterable["RunPlan"]) -> Iterable["RunPlan"]:
    for plan in plans:
        control = plan.control
        yield replace(
            plan,
            case=f"{name}.{plan.case}",
            control=None if control is None else replace(control, case=f"{name}.{control.case}"),
        )
