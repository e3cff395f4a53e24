"""Read the search of a campaign file; all of its problems are reported at once, with places."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath

import numpy as np

from wil_campaign.campaigns.checks.autonomy_checks import IsolatedBuilds
from wil_campaign.campaigns.expansion.case_reader import collect_problems, read_setup
from wil_campaign.campaigns.expansion.composition import is_composition
from wil_campaign.campaigns.expansion.expansion import (
    Campaign,
    ExpansionOptions,
    load_campaign,
    requested_bench,
)
from wil_campaign.campaigns.schema import Mode, matrix_keys
from wil_campaign.campaigns.setup.bench_resolution import bench_completion
from wil_campaign.campaigns.setup.case_files import CaseFiles, case_files
from wil_campaign.campaigns.setup.overrides import Override, override_from_option, overrides_of_case
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Path,
    Problem,
    YamlEntry,
    check_document,
    closest_word,
    load_document,
)
from wil_campaign.foundation.files.problems import unit_of_key
from wil_campaign.foundation.files.yaml_nodes import YamlNode, YamlPlace, mapping_node
from wil_campaign.plugins.search.exploration.constraints import SpaceConstraint, parse_constraint
from wil_campaign.plugins.search.exploration.objective import (
    SearchObjective,
    fails_no_flight,
    lacks_margin,
)
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter
from wil_campaign.plugins.search.exploration.strategies import random_point
from wil_campaign.plugins.search.search_part import ParameterPart, ParameterValue, SearchPart
from wil_campaign.plugins.stl.formula import StlError
from wil_campaign.plugins.stl.units import SignalKind

_AT: Path = ("search",)


def load_search(path: FilePath, options: ExpansionOptions | None = None) -> SearchCampaign:
    """Return a campaign file with its search. Raises BadInput with every problem found."""
    options = options or ExpansionOptions()
    original = load_document(path)
    if is_composition(original):
        message = "is made of campaigns; a search varies a single one: give the file of that one"
        raise BadInput([original.problem(("campaigns",), message, key=True)])
    campaign = load_campaign(path, options)
    if not has_search(campaign):
        message = f"has no `search`; to fly its cases use `wil-campaign run {path}`"
        raise BadInput([campaign.document.problem((), message)])
    return read_search(campaign)


def has_search(campaign: Campaign) -> bool:
    """Return whether a campaign's file has a search."""
    return campaign.document.get(_AT) is not None


def read_search(campaign: Campaign) -> SearchCampaign:
    """Return the search of a loaded campaign that has one. Raises BadInput."""
    return _Reader(campaign, check_document(campaign.document, SearchPart, _AT)).read()


class _Reader:
    """Reads one search; problems are collected."""

    def __init__(self, campaign: Campaign, part: SearchPart) -> None:
        self._campaign = campaign
        self._whole = campaign.document
        self._part = part
        self._options = campaign.options
        self._builds = IsolatedBuilds() if campaign.options.is_autonomy_isolated else None
        self._complete = bench_completion(next(iter(campaign.benches), None))
        self._problems: list[Problem] = []

    def read(self) -> SearchCampaign:
        document = without_search(_without_bench(self._campaign))
        case = self._case()
        own = () if case is None else overrides_of_case(document, case)
        given = tuple(override_from_option("--set", text) for text in self._options.sets)
        given = tuple(
            override for override in given if not override.dotted_key.startswith("search.")
        )
        files, _ = case_files(document, (*own, *given), self._complete)
        self._check_modes()
        parameters = tuple(self._parameters(files, (*own, *given), document))
        self._check_objective(case)
        self._check_strategy(parameters)
        space = SearchSpace(parameters=parameters)
        constraints = tuple(self._constraints(parameters))
        if not self._problems:
            space = replace(space, constraints=constraints)
            self._check_space(space)
        if self._problems or case is None:
            raise BadInput(self._problems)
        return SearchCampaign(
            campaign=self._campaign,
            document=document,
            part=self._part,
            case=case,
            case_overrides=own,
            option_overrides=given,
            space=space,
            objective=SearchObjective(oracles=self._part.oracles, scale=self._part.scale),
        )

    def _report(self, path: Path, message: str, meant: str = "", *, key: bool = False) -> None:
        self._problems.append(self._whole.problem((*_AT, *path), message, meant, key=key))

    def _case(self) -> str | None:
        """Return the case that is varied; None where there is no such case."""
        cases = self._campaign.cases
        wanted = self._part.case
        if wanted is None:
            return cases[0]
        if wanted in cases:
            return wanted
        self._report(("case",), f"unknown case '{wanted}'", closest_word(wanted, cases))
        return None

    def _check_modes(self) -> None:
        """Report modes of the budget that the campaign does not fly, or too small a budget."""
        known: Sequence[Mode] = self._campaign.modes
        for mode, flights in self._part.flights_by_mode.items():
            if mode not in known:
                message = f"mode '{mode}' is not flown (modes: {', '.join(known)})"
                self._report(("budget", mode), message, key=True)
            elif flights < self._part.seeds:
                message = f"is less than the {self._part.seeds} flights of one variant (seeds)"
                self._report(("budget", mode), message)

    def _check_objective(self, case: str | None) -> None:
        """Report oracles that have no margin, or cannot fail a flight in a mode of the budget."""
        setup = None if case is None else self._campaign.setups[case]
        uses = {} if setup is None else {use.name: use for use in setup.oracles}
        modes = [mode for mode in self._part.flights_by_mode if mode in self._campaign.modes]
        flying = {} if setup is None else {mode: setup.flying(mode) for mode in modes}
        is_list = isinstance(self._part.objective, list)
        for index, name in enumerate(self._part.oracles):
            path: Path = ("objective", index) if is_list else ("objective",)
            if name not in uses:
                meant = closest_word(name, uses)
                known = "" if meant else f" (the campaign has: {', '.join(uses)})"
                self._report(path, f"unknown oracle '{name}'{known}", meant)
            elif message := lacks_margin(uses[name]) or fails_no_flight(uses[name], flying):
                self._report(path, message)
        for name in self._part.scale:
            if name not in self._part.oracles:
                self._report(
                    ("scale", name), f"'{name}' is not an oracle of the objective", key=True
                )

    def _check_strategy(self, parameters: Sequence[SpaceParameter]) -> None:
        """Report parameters that CMA-ES cannot vary."""
        if self._part.strategy != "cma-es":
            return
        if len(parameters) < 2:
            self._report(("strategy",), "cma-es needs at least 2 parameters; use tpe")
        for parameter in parameters:
            if parameter.choices:
                message = "cma-es varies numbers only, and these are choices; use tpe"
                self._report(("parameters", parameter.name, "choices"), message, key=True)

    def _constraints(self, parameters: Sequence[SpaceParameter]) -> Iterator[SpaceConstraint]:
        """Yield the constraints; wrong ones are reported at the offset of the mistake."""
        kinds = {
            parameter.name: _kind_of(parameter)
            for parameter in parameters
            if _is_calculable(parameter)
        }
        for index, text in enumerate(self._part.constraints):
            path: Path = (*_AT, "constraints", index)
            try:
                yield parse_constraint(text, kinds)
            except StlError as error:
                message = str(error).replace("unknown signal", "unknown parameter")
                self._problems.append(
                    self._whole.problem_within(path, error.offset, message, error.suggestion)
                )

    def _check_space(self, space: SearchSpace) -> None:
        """Report constraints that no variant keeps."""
        rng = np.random.default_rng(0)
        if space.constraints and random_point(space, rng) is None and not space.listed():
            message = (
                "leave no variant: no point within the limits of the parameters keeps all of them"
            )
            self._report(("constraints",), message, key=True)

    def _parameters(
        self, files: CaseFiles, overrides: tuple[Override, ...], document: Document
    ) -> Iterator[SpaceParameter]:
        """Yield the parameters; keys that no file has are reported."""
        keys: dict[str, str] = {}
        for name, part in self._part.parameters.items():
            is_list = isinstance(part.key, list)
            for index, key in enumerate(part.keys):
                at: Path = ("parameters", name, "key", *((index,) if is_list else ()))
                if key.partition(".")[0] in matrix_keys():
                    self._report(at, f"'{key}' is the same for all cases")
                elif key in keys:
                    self._report(at, f"'{key}' is already varied by '{keys[key]}'")
                else:
                    keys[key] = name
                    place = self._whole.entry((*_AT, *at)).node.place
                    self._problems += self._key_problems(part, key, place, overrides, document)
            yield _parameter(name, part, files)

    def _key_problems(
        self,
        part: ParameterPart,
        key: str,
        place: YamlPlace,
        overrides: tuple[Override, ...],
        document: Document,
    ) -> list[Problem]:
        """Return the problem of a key, if all of its values have one; not those of the case."""
        first: list[Problem] = []
        for value in _parameter("", part, None).levels:
            override = Override(key, YamlEntry(place, YamlNode(value, place)))
            wrong: list[Problem] = []
            files, problems = case_files(document, (*overrides, override), self._complete)
            wrong += problems
            if not problems:
                read = partial(
                    read_setup,
                    files,
                    tuple(self._part.flights_by_mode),
                    builds=self._builds,
                    loads_code=self._options.loads_code,
                )
                collect_problems(wrong, read)
            own = [problem for problem in wrong if _is_at(problem, place)]
            if not own:
                return []
            first = first or own[:1]
        return [replace(problem, message=f"'{key}': {problem.message}") for problem in first]


def _without_bench(campaign: Campaign) -> Document:
    """Return a campaign's document without the values of its bench.

    A parameter that changes one of these is then the same problem as an override of a case.
    """
    if not campaign.benches:
        return campaign.document
    request = requested_bench(campaign.document.path, campaign.options)
    return campaign.document if request is None else request[0]


def without_search(document: Document) -> Document:
    """Return a campaign's document without its search, on which no flight depends."""
    root = document.root
    if not isinstance(root.value, dict):
        return document
    kept: Mapping[str, YamlEntry] = {
        key: entry for key, entry in root.value.items() if key != "search"
    }
    return Document(document.path, mapping_node(dict(kept), root.place))


def _parameter(name: str, part: ParameterPart, files: CaseFiles | None) -> SpaceParameter:
    """Return a parameter; its own value is that of the files. files=None: without an own value."""
    values = [_own_value(files, key) for key in part.keys] if files is not None else []
    is_one = bool(values) and all(value == values[0] for value in values)
    return SpaceParameter(
        name=name,
        keys=part.keys,
        low=0.0 if part.from_ is None else part.from_,
        high=1.0 if part.to is None else part.to,
        is_integer=part.integer,
        choices=tuple(part.choices or ()),
        steps=part.steps,
        unit=unit_of_key(part.keys[0]).replace("_", "/", 1),
        own=values[0] if is_one else None,
    )


def _own_value(files: CaseFiles, key: str) -> ParameterValue | None:
    """Return the value of a dotted key in the files; None where that is no single value."""
    override = Override(key, YamlEntry(files.campaign.root.place, files.campaign.root))
    document = {"world": files.world, "recipe": files.recipe}.get(override.file, files.campaign)
    if document is None:
        return None
    path = tuple(
        int(step) if step.isdecimal() else step for step in override.key_in_file.split(".")
    )
    value = document.get(path)
    return value if isinstance(value, bool | int | float | str) else None


def _is_calculable(parameter: SpaceParameter) -> bool:
    """Return whether a constraint can use a parameter: none of its values is a text."""
    return not any(isinstance(choice, str) for choice in parameter.choices)


def _kind_of(parameter: SpaceParameter) -> SignalKind:
    """Return a parameter as a signal of constraints: true or false, or a number with its unit."""
    if parameter.choices and all(isinstance(choice, bool) for choice in parameter.choices):
        return SignalKind("", parameter.name)
    return SignalKind(parameter.unit or "1", parameter.name)


def _is_at(problem: Problem, place: YamlPlace) -> bool:
    return (problem.file, problem.line, problem.column) == (
        place.source.name,
        place.line,
        place.column,
    )
