"""Prepares a flight on its engine: this machine, or one that a plugin adds.

Used by `run`, `search` and the Python API.
"""

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import (
    Campaign,
    ExpansionOptions,
    load_campaign,
    requested_bench,
)
from wil_campaign.hooks import Engine, engines
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_benches, held_links
from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    remove_earlier_junit,
    require_writable_results,
)
from wil_campaign.orchestrator.campaign.folder.repetitions import runs_planned
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from wil_campaign.orchestrator.campaign.workers.run_engine import LOCAL, EngineError
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
from wil_campaign.orchestrator.cli.arming_consent import (
    REFUSED,
    FlightRefusedError,
    clear_for_flight,
)


@contextmanager
def ready_flight(
    file: Path, selection: ExpansionOptions, options: FlightOptions
) -> Iterator[tuple[Campaign, ClearedCampaign]]:
    """Yield a campaign that may be flown, after consent where it is required.

    Its engine and its bench are reserved until the end. A junit.xml of an earlier campaign in the
    place of its own is removed. Raises BadInput, OutputError, RefusedError,
    EngineError, TakenError.
    """
    if options.junit is not None:
        remove_earlier_junit(options.junit)
    if options.engine == LOCAL:
        result_store(options)
        with _ready_here(file, selection, options) as flight:
            yield flight
        return
    check_engine(options.engine)
    if selection.benches:
        raise FlightRefusedError(
            f"--engine {options.engine}: a cluster has its own benches; leave --bench-file out",
            REFUSED,
        )
    request = requested_bench(file, selection)
    if request is None:
        ready = _ready_elsewhere(load_selected(file, selection, options), options)
    else:
        on_bench = load_plugin_object(_engine_of(options.engine).on_bench)
        ready = on_bench(file, selection, options, *request)
    with ready as flight:
        yield flight


def load_selected(file: Path, selection: ExpansionOptions, options: FlightOptions) -> Campaign:
    """Return the campaign with the requested runs. Raises BadInput, RefusedError."""
    campaign = load_campaign(file, selection)
    if options.runs is None:
        return campaign
    known = {plan.name for plan in campaign.plans}
    if unknown := [name for name in options.runs if name not in known]:
        raise FlightRefusedError(f"the campaign has no run '{unknown[0]}'", REFUSED)
    return campaign_of_runs(campaign, frozenset(options.runs))


def campaign_of_runs(campaign: Campaign, names: Collection[str]) -> Campaign:
    """Return a campaign with only some of its runs and controls; `left_out` counts the others.

    It requires the share of the runs that are left, as with --repetitions.
    """
    runs = tuple(plan for plan in campaign.runs if plan.name in names)
    controls = tuple(plan for plan in campaign.controls if plan.name in names)
    counts = Counter[tuple[str, str]]((plan.case, plan.mode) for plan in runs)
    requirements = tuple(
        replace(wanted, share=wanted.share.scaled(count))
        for wanted in campaign.requirements
        if (count := counts[wanted.case, wanted.mode])
    )
    missing = len(campaign.plans) - len(runs) - len(controls)
    left_out = (f"{missing} of {len(campaign.plans)} runs and controls",) if missing else ()
    return replace(
        campaign,
        runs=runs,
        controls=controls,
        requirements=requirements,
        left_out=(*campaign.left_out, *left_out),
    )


def check_engine(text: str) -> None:
    """Raise EngineError for a value of --engine that cannot be used."""
    if text != LOCAL:
        load_plugin_object(_engine_of(text).check)(text)


@contextmanager
def cleared_on_engine(
    campaign: Campaign, options: FlightOptions, cleared: ClearedCampaign, *, runs: int, again: bool
) -> Iterator[ClearedCampaign]:
    """Start the engine named by --engine; yield the clearance to fly `runs` there.

    again: the engine flies further campaigns. Raises EngineError.
    """
    store = result_store(options)
    if options.engine == LOCAL:
        yield cleared
        return
    start = load_plugin_object(_engine_of(options.engine).start)
    with start(campaign, options, cleared, store=store, runs=runs, again=again) as elsewhere:
        yield elsewhere


def result_store(options: FlightOptions) -> object:
    """Return the store of --store; None without. Raises EngineError for one that is refused."""
    if not options.store:
        return None
    if options.engine == LOCAL:
        raise EngineError(
            "--store: --engine local writes its results to --out; leave --store out", 2
        )
    if not (store := _engine_of(options.engine).store):
        raise EngineError(f"--store: --engine {options.engine} uses none; leave --store out", 2)
    found: object = load_plugin_object(store)(options.store)
    return found


def _engine_of(text: str) -> Engine:
    """Return the engine of a plugin that a value of --engine names. Raises EngineError."""
    name, known, missing = (
        text.partition("://")[0],
        plugin_additions(engines, (LOCAL,)),
        absent_additions(engines),
    )
    if name in known:
        return known[name]
    if name in missing:
        raise EngineError(f"--engine {text}: {missing[name]}", 2)
    values = ", ".join([LOCAL, *(engine.values for engine in known.values())])
    raise EngineError(f"--engine {text}: must be {values}", 2)


@contextmanager
def _ready_here(
    file: Path, selection: ExpansionOptions, options: FlightOptions
) -> Iterator[tuple[Campaign, ClearedCampaign]]:
    """Prepare a flight in processes of this machine.

    Raises BadInput where the radio of a simulation cannot carry the ground truth that it offers.
    """
    start_run_server()  # it imports while the campaign is read
    campaign = load_selected(file, selection, options)
    require_writable_results(options.out, junit=options.junit)
    links = [link for flown in attached_vehicles(campaign) for link in flown.addresses]
    # Before a vehicle is touched, and a person asked.
    with held_benches(campaign.benches), held_links(links):
        cleared = clear_for_flight(campaign, options)
        if cleared.settings:
            settled = replace(selection, sets=(*selection.sets, *cleared.settings))
            campaign = load_selected(file, settled, options)
        yield campaign, cleared


@contextmanager
def _ready_elsewhere(
    campaign: Campaign, options: FlightOptions
) -> Iterator[tuple[Campaign, ClearedCampaign]]:
    """Prepare a flight by an engine of a plugin."""
    _refuse_attached(campaign, options.engine)
    require_writable_results(options.out, junit=options.junit)
    here = clear_for_flight(campaign, options)
    runs = len(runs_planned(campaign, arm=options.arm))
    with cleared_on_engine(campaign, options, here, runs=runs, again=False) as cleared:
        yield campaign, cleared


def _refuse_attached(campaign: Campaign, engine: str) -> None:
    """Raise RefusedError for attached vehicles on another engine than that of this machine."""
    if attached := attached_vehicles(campaign):
        names = " and ".join(f"{flown.name} ({flown.attached})" for flown in attached)
        raise FlightRefusedError(
            f"--engine {engine}: {names} is attached to one machine, where consent to arm is "
            "given; fly there with --engine local",
            REFUSED,
        )
