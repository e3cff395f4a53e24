"""Expand a campaign file into runs: cases x modes x repetitions, each with its seed and files."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from wil_campaign.campaigns.checks.autonomy_checks import IsolatedBuilds
from wil_campaign.campaigns.checks.case_warnings import case_warnings, caveats_of
from wil_campaign.campaigns.checks.import_warnings import import_warnings
from wil_campaign.campaigns.expansion.case_problems import problems_with_cases
from wil_campaign.campaigns.expansion.case_reader import (
    collect_problems,
    read_setup,
    unique_problems,
)
from wil_campaign.campaigns.expansion.composition import compose_campaigns, is_composition
from wil_campaign.campaigns.expansion.controls import (
    control_expectation,
    control_problems,
    control_warnings,
    files_of_controls,
    modes_of_control,
)
from wil_campaign.campaigns.expansion.omissions import (
    campaign_as_required,
    left_out_requirements,
    set_option_caveats,
)
from wil_campaign.campaigns.expansion.requirements import (
    required_shares,
    unflown_firmware,
    unknown_published_cases,
)
from wil_campaign.campaigns.schema import DEFAULT_CASE, CampaignPart, Mode, campaign_model
from wil_campaign.campaigns.schema.bench import BenchRequestPart
from wil_campaign.campaigns.schema.between_runs import BetweenRunsPart
from wil_campaign.campaigns.schema.composition import CompositionPart
from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.campaigns.setup.bench_resolution import (
    bench_completion,
    bench_request,
    choose_bench,
)
from wil_campaign.campaigns.setup.case_files import CaseFiles, case_files
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.setup.overrides import Override, override_from_option, overrides_of_case
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.campaigns.values.expectation import Expectation
from wil_campaign.campaigns.values.seeds import run_seed
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Problem,
    check_document,
    closest_word,
    load_document,
    parse_option_value,
)
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.hooks import operator_channels
from wil_campaign.installed_plugins import plugin_additions


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpansionOptions:
    """The command line's selections and overrides before expansion; None keeps the file's.

    cases: globs. sets: KEY=VALUE as given to --set, which win over the overrides of a case.
    is_autonomy_isolated: whether the autonomy is tried in a child process, for a limited time.
    loads_code: False: neither the autonomy nor the user's own steps are loaded; such a campaign
    cannot be flown. benches: those on which the campaign may be flown, where it asks for one.
    composition: of which the campaign is a part, if it is one; its values are in the other fields.
    """

    cases: tuple[str, ...] = ()
    modes: tuple[str, ...] = ()
    repetitions: int | None = None
    seed: int | None = None
    sets: tuple[str, ...] = ()
    is_autonomy_isolated: bool = False
    loads_code: bool = True
    benches: tuple[Bench, ...] = ()
    composition: CompositionPart | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPlan:
    """One planned run of the expansion; picklable. repetition from 1; required: for `accept`.

    retries: how often it is flown again where it ends as ERROR or INVALID. control: how it must
    end, if it is one; its name then is the case. loads_code: see `ExpansionOptions`.
    """

    campaign: str
    case: str
    mode: Mode
    repetition: int
    seed: int
    required: bool
    files: CaseFiles
    retries: int = 0
    control: Expectation | None = None
    loads_code: bool = True

    @property
    def name(self) -> str:
        """Return the planned run's folder below the campaign's: case/mode/repetition."""
        return f"{self.case}/{self.mode}/{self.repetition}"

    def setup(self) -> Case:
        """Return the setup of a planned run, read from its documents. Raises BadInput."""
        return read_setup(self.files, (self.mode,), loads_code=self.loads_code)


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """A checked campaign expanded into runs, ordered by case, mode and repetition; then controls.

    document: the campaign file after --repetitions, --seed and --set. paths: every file it was
    read from. modes, cases: those selected. repetitions: at most; test: that may end them sooner,
    None for a fixed number. setups: of these cases and of the controls. requirements: of the
    selected cases and modes. left_out: what the file requires and the options leave out, in words.
    operators: the setups of the channels of operators by their keys. between: how an attached
    vehicle returns to its start, if given. controls: the runs that must not pass. warnings: what is
    valid in its files and probably not meant. caveats: those of them that qualify a verdict, in
    words. options: of the command line. benches: on which it is flown, one for each composed
    campaign that asks for one.
    """

    name: str
    description: str
    document: Document
    paths: tuple[Path, ...]
    cases: tuple[str, ...]
    modes: tuple[Mode, ...]
    repetitions: int
    seed: int
    setups: Mapping[str, Case]
    runs: tuple[RunPlan, ...]
    requirements: tuple[PassRequirement, ...]
    left_out: tuple[str, ...] = ()
    operators: Mapping[str, object] = field(default_factory=dict)
    test: SequentialTest | None = None
    between: BetweenRunsPart | None = None
    controls: tuple[RunPlan, ...] = ()
    warnings: tuple[Problem, ...] = ()
    caveats: tuple[str, ...] = ()
    options: ExpansionOptions = ExpansionOptions()
    benches: tuple[Bench, ...] = ()

    @property
    def plans(self) -> tuple[RunPlan, ...]:
        """Return the planned runs of the expansion: the cases' runs, then the controls."""
        return (*self.runs, *self.controls)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Read:
    """A campaign's files, read and checked. document: with what the bench adds.

    files, setups: of cases and controls.
    """

    original: Document
    document: Document
    part: CampaignPart
    bench: Bench | None
    files: Mapping[str, CaseFiles]
    setups: Mapping[str, Case]

    @property
    def retries(self) -> int:
        """Return the retries of each run; on a bench a person first has to find out what failed."""
        return self.part.retries if self.bench is None else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Selected:
    """What the command line selects of a campaign. names: of cases and controls; shares: all.

    runs: the cases and modes that are flown.
    """

    names: tuple[str, ...]
    modes: tuple[Mode, ...]
    shares: Mapping[tuple[str, str], PassShare]
    operators: Mapping[str, object]
    cases: tuple[str, ...]
    runs: tuple[tuple[str, Mode], ...]
    controls: tuple[RunPlan, ...]


def load_campaign(path: Path, options: ExpansionOptions | None = None) -> Campaign:
    """Return a campaign file expanded into its runs. Raises BadInput with every problem."""
    options = options or ExpansionOptions()
    original = load_document(path)
    if is_composition(original):
        return compose_campaigns(original, options, load_campaign)
    read = _read(original, options)
    selected = _select(read, options)
    part, bench, files, setups = read.part, read.bench, read.files, read.setups
    caveats = problems_with_cases(
        {name: caveats_of(files[name], setups[name], tuple(part.modes)) for name in selected.cases},
        selected.cases,
    )
    injected = [
        f"fault injected: {fault}" for name in selected.cases for fault in setups[name].faults
    ]
    # A composition's own options hold for all of its parts: it names them once.
    given = [] if options.composition else set_option_caveats(options.sets, original)
    warnings = problems_with_cases(
        {name: _warnings(part, name, files[name], setups[name]) for name in selected.names},
        selected.cases,
    )
    warnings += [*control_warnings(read.document, part), *_idle_operator(read.document, part)]
    required = campaign_as_required(original, read.document, part, options.composition)
    flown = {*selected.runs, *((plan.case, plan.mode) for plan in selected.controls)}
    return Campaign(
        name=part.campaign,
        description=part.description,
        document=read.document,
        paths=_paths([files[name] for name in selected.names], bench),
        cases=selected.cases,
        modes=selected.modes,
        repetitions=part.most_repetitions,
        seed=part.seed,
        setups={name: setups[name] for name in selected.names},
        runs=tuple(_runs(read, selected, options)),
        requirements=tuple(
            PassRequirement(case, mode, selected.shares[case, mode], part.sequential_test)
            for case, mode in selected.runs
            if (case, mode) in selected.shares
        ),
        left_out=left_out_requirements(required, part, flown, selected.shares),
        operators=selected.operators,
        test=part.sequential_test,
        between=part.between_runs,
        controls=selected.controls,
        warnings=unique_problems([*caveats, *warnings]),
        caveats=tuple(dict.fromkeys([caveat.message for caveat in caveats] + injected + given)),
        options=options,
        benches=() if bench is None else (bench,),
    )


def _read(original: Document, options: ExpansionOptions) -> _Read:
    """Return a campaign's files of every case and control. Raises BadInput with every problem."""
    overrides = _option_overrides(options)
    plain = _with_overrides(original, overrides)
    bench = choose_bench(plain, options.benches)
    complete = bench_completion(bench)
    document = complete(plain)
    problems: list[Problem] = []
    warnings: list[Problem] = []
    part = collect_problems(problems, partial(check_document, document, campaign_model()))
    files = _files_of_cases(plain, overrides, problems, complete)
    of_controls = files_of_controls(plain, part, overrides, problems, complete)
    read = partial(
        read_setup,
        builds=IsolatedBuilds() if options.is_autonomy_isolated else None,
        loads_code=options.loads_code,
    )
    bad: dict[str, BadInput] = {}
    setups = _setups(read, files, () if part is None else tuple(part.modes), bad)
    if part is not None:
        for name, of_control in of_controls.items():
            flown = modes_of_control(part, part.controls[name])
            setups |= _setups(read, {name: of_control}, flown, bad)
    problems += problems_with_cases({name: error.problems for name, error in bad.items()}, files)
    warnings += problems_with_cases({name: error.warnings for name, error in bad.items()}, files)
    if part is not None:
        problems += control_problems(document, part, setups)
    if part is None or problems:
        raise BadInput(unique_problems(problems), unique_problems(warnings))
    return _Read(
        original=original,
        document=document,
        part=part,
        bench=bench,
        files=files | of_controls,
        setups=setups,
    )


def _select(read: _Read, options: ExpansionOptions) -> _Selected:
    """Return what the command line selects. Raises BadInput with every problem."""
    part, problems = read.part, list[Problem]()
    names = _select_cases("--case", options.cases, (*part.cases, *part.controls), problems)
    mode_names = _select_cases("--mode", options.modes, tuple(part.modes), problems)
    shares = required_shares(read.original, read.document, part, problems)
    problems += unknown_published_cases(read.document, part)
    problems += unflown_firmware(read.document, part, read.setups)
    operators = {
        name: channel.setup(read.document, part.operator, problems)
        for name, channel in part.operator.channels.items()
    }
    if problems:
        raise BadInput(unique_problems(problems))
    cases = tuple(name for name in names if name in part.cases)
    modes = tuple(mode for mode in part.modes if mode in mode_names)
    return _Selected(
        names=names,
        modes=modes,
        shares=shares,
        operators=operators,
        cases=cases,
        runs=tuple((case, mode) for case in cases for mode in modes),
        controls=tuple(
            plan
            for plan in _controls(read, options)
            if plan.case in names and plan.mode in mode_names
        ),
    )


def requested_bench(
    path: Path, options: ExpansionOptions
) -> tuple[Document, BenchRequestPart] | None:
    """Return a campaign's document and its request for a bench. Raises BadInput.

    None without a request, and for a composition, whose parts ask for benches of this machine.
    """
    original = load_document(path)
    if is_composition(original):
        return None
    document = _with_overrides(original, _option_overrides(options))
    request = bench_request(document)
    return None if request is None else (document, request)


def _paths(files: Iterable[CaseFiles], bench: Bench | None) -> tuple[Path, ...]:
    found = [path for file in files for path in file.paths]
    if bench is not None and is_file(bench.document.path):
        found.append(bench.document.path)
    return tuple(dict.fromkeys(found))


def _warnings(part: CampaignPart, name: str, file: CaseFiles, setup: Case) -> Iterator[Problem]:
    control = part.controls.get(name)
    modes = tuple(part.modes) if control is None else modes_of_control(part, control)
    yield from case_warnings(file.without_cases, setup, modes)
    yield from import_warnings(file, setup)


def _idle_operator(base: Document, part: CampaignPart) -> Iterator[Problem]:
    """Yield a warning for what is done on the loss of operators that the campaign does not have."""
    operator = part.operator
    if operator.on_operator_loss != "continue" and not operator.channels:
        channels = ", ".join(plugin_additions(operator_channels))
        message = f"never acts: no channel of operators ({channels})"
        yield base.problem(("operator", "on_operator_loss"), message)


def _option_overrides(options: ExpansionOptions) -> tuple[Override, ...]:
    """Return --set, --repetitions and --seed as overrides of the campaign to be expanded."""
    problems: list[Problem] = []
    found = [
        collect_problems(problems, partial(override_from_option, "--set", text))
        for text in options.sets
    ]
    for key, value in (("repetitions", options.repetitions), ("seed", options.seed)):
        if value is not None:
            entry = parse_option_value(str(value), name=f"--{key} {value}")
            found.append(Override(key, entry))
    if problems:
        raise BadInput(problems)
    return tuple(override for override in found if override is not None)


def _with_overrides(document: Document, overrides: Iterable[Override]) -> Document:
    """Return the campaign document with the overrides applied that are for the campaign file."""
    for override in overrides:
        if override.file == "campaign":
            document = document.override(override.dotted_key, override.entry)
    return document


def _files_of_cases(
    base: Document,
    overrides: tuple[Override, ...],
    problems: list[Problem],
    complete: Callable[[Document], Document],
) -> dict[str, CaseFiles]:
    """Return the files of every expanded case; the command line's overrides win."""
    given = base.get(("cases",))
    names = list(given) if isinstance(given, dict) and given else [DEFAULT_CASE]
    found: dict[str, CaseFiles] = {}
    for name in names:
        own = collect_problems(problems, partial(overrides_of_case, base, name)) or ()
        found[name], wrong = case_files(base, (*own, *overrides), complete)
        problems += wrong
    return found


def _setups(
    read: Callable[[CaseFiles, tuple[Mode, ...]], Case],
    files: Mapping[str, CaseFiles],
    modes: tuple[Mode, ...],
    bad: dict[str, BadInput],
) -> dict[str, Case]:
    """Return the setup of every expanded case; what is wrong with others is collected by name."""
    found: dict[str, Case] = {}
    for name, file in files.items():
        try:
            found[name] = read(file, modes)
        except BadInput as error:
            bad[name] = error
    return found


def _select_cases(
    option: str, patterns: Sequence[str], known: tuple[str, ...], problems: list[Problem]
) -> tuple[str, ...]:
    """Return the cases of the expansion that match a pattern, in file order; all without one."""
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in known):
            message = f"matches none of {', '.join(known)}"
            problems.append(
                Problem(f"{option} {pattern}", 0, 0, message, "", closest_word(pattern, known))
            )
    if not patterns:
        return known
    return tuple(name for name in known if any(fnmatchcase(name, p) for p in patterns))


def _runs(read: _Read, selected: _Selected, options: ExpansionOptions) -> Iterable[RunPlan]:
    """Yield the planned runs of the selected cases and modes, repetition by repetition."""
    part = read.part
    for case, mode in selected.runs:
        for repetition in range(1, part.most_repetitions + 1):
            seed = run_seed(part.seed, case, repetition)
            yield RunPlan(
                campaign=part.campaign,
                case=case,
                mode=mode,
                repetition=repetition,
                seed=seed,
                required=(case, mode) in selected.shares,
                files=read.files[case].seeded(seed),
                retries=read.retries,
                loads_code=options.loads_code,
            )


def _controls(read: _Read, options: ExpansionOptions) -> Iterable[RunPlan]:
    """Yield each control run of the expansion once in each of its modes.

    Its seed is that of the first repetition of the case that it changes: nothing else differs.
    """
    part = read.part
    for name, control in part.controls.items():
        expected = control_expectation(part, control, read.setups[name])
        seed = run_seed(part.seed, expected.case, 1)
        for mode in modes_of_control(part, control):
            yield RunPlan(
                campaign=part.campaign,
                case=name,
                mode=mode,
                repetition=1,
                seed=seed,
                required=False,
                files=read.files[name].seeded(seed),
                retries=read.retries,
                control=expected,
                loads_code=options.loads_code,
            )
