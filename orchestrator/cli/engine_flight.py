"""Prepares a flight on its engine: this machine, a cluster, or a bench of a cluster.

Used by `run`, `search` and the Python API.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from campaigns.expansion.expansion import Campaign, Options, load_campaign
from orchestrator.campaign.campaign_runner import FlyingSettings
from orchestrator.campaign.folder.bench_lock import held_benches
from orchestrator.campaign.folder.campaign_folder import require_writable
from orchestrator.campaign.folder.repetitions import planned
from orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from orchestrator.campaign.workers.run_engine import EngineError, LocalRunEngine, RunEngine
from orchestrator.campaign.workers.run_server import start_run_server
from orchestrator.cli.arming_consent import REFUSED, Cleared, RefusedError, clear
from orchestrator.cli.bench_flight import bench_flight, is_for_bench
from orchestrator.cli.clock_choice import shared_of
from orchestrator.cli.standard_streams import err
from orchestrator.engines.ray_engine import engine_address, ray_engine
from orchestrator.model.clock import Clock
from orchestrator.storage.store import Store, StoreRefusedError, open_store

LOCAL = "local"
"""The engine of this machine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOrder:
    """The campaign to fly and the options of `run` for it.

    select: reduces the campaign to the runs to fly. Without arm each case and mode is tried up to
    arming.
    """

    file: Path
    options: Options
    out: Path
    junit: Path | None = None
    engine: str = LOCAL
    store: str = ""
    clock: Clock | None = None
    jobs: int | None = None
    resume: bool = False
    arm: bool = True
    arm_real: bool = False
    arm_actors: bool = False
    again: tuple[str, ...] = ()
    select: Callable[[Campaign], Campaign] = lambda campaign: campaign

    def load(self) -> Campaign:
        """Return the campaign with the requested runs. Raises BadInput."""
        return self.select(load_campaign(self.file, self.options))

    def settings(self, cleared: Cleared) -> FlyingSettings:
        """Return how a campaign that was cleared is flown."""
        return FlyingSettings(
            out=self.out,
            clock=cleared.clock,
            jobs=cleared.jobs,
            junit=self.junit,
            resume=self.resume,
            again=self.again,
            arm=self.arm,
            real_kind=cleared.real_kind,
            hardware=cleared.hardware,
        )


@contextmanager
def ready_flight(order: FlightOrder) -> Iterator[tuple[Campaign, FlyingSettings]]:
    """Yield a campaign that may be flown, after consent where it is required, and its settings.

    Its engine and its bench are reserved until the end. Raises BadInput, OutputError, RefusedError,
    EngineError, TakenError.
    """
    if order.engine == LOCAL:
        result_store(order.store, order.engine)
        with _ready_here(order) as flight:
            yield flight
        return
    address = engine_address(order.engine)
    is_of_bench = is_for_bench(order.file, order.options, order.engine)
    if is_of_bench and address is not None:
        ready = _ready_on_bench(order, address)
    else:
        ready = _ready_over_cluster(order)
    with ready as flight:
        yield flight


@contextmanager
def runs_engine(
    text: str,
    campaign: Campaign,
    cleared: Cleared,
    *,
    store: str,
    jobs: int | None,
    runs: int,
    again: bool,
) -> Iterator[tuple[RunEngine, int]]:
    """Start the engine named by --engine; yield it, and how many of `runs` fly at once.

    store, jobs: the values of --store and --jobs. again: it flies further campaigns. Raises
    EngineError.
    """
    place = result_store(store, text)
    if text == LOCAL:
        yield LocalRunEngine(), cleared.jobs
        return
    address = engine_address(text)
    # A cluster has more cores than this machine.
    is_open = address is not None and jobs is None and not shared_of(campaign)
    count = None if is_open else min(cleared.jobs, runs)
    cores = 1 if cleared.clock == "virtual" else 2
    with ray_engine(
        address, jobs=count, cores=cores, keeps_agents=again, store=place, say=err
    ) as engine:
        yield engine, engine.places


def result_store(url: str, engine: str) -> Store | None:
    """Return the store of --store; None without. Raises EngineError for one that is refused."""
    if not url:
        return None
    if engine == LOCAL:
        raise EngineError(
            "--store: --engine local writes its results to --out; leave --store out", 2
        )
    try:
        return open_store(url)
    except StoreRefusedError as error:
        raise EngineError(str(error), 2) from error


@contextmanager
def _ready_here(order: FlightOrder) -> Iterator[tuple[Campaign, FlyingSettings]]:
    """Prepare a flight in processes of this machine."""
    campaign = order.load()
    start_run_server()
    require_writable(order.out, junit=order.junit)
    settings = order.settings(_clear(campaign, order))
    with held_benches(campaign.benches):
        yield campaign, settings


@contextmanager
def _ready_over_cluster(order: FlightOrder) -> Iterator[tuple[Campaign, FlyingSettings]]:
    """Prepare a flight over the nodes of a cluster."""
    campaign = order.load()
    _refuse_attached(campaign, order.engine)
    require_writable(order.out, junit=order.junit)
    cleared = _clear(campaign, order)
    settings = order.settings(cleared)
    runs = len(planned(campaign, arm=settings.arm))
    with runs_engine(
        order.engine,
        campaign,
        cleared,
        store=order.store,
        jobs=order.jobs,
        runs=runs,
        again=False,
    ) as (engine, at_once):
        yield campaign, replace(settings, engine=engine, jobs=at_once)


@contextmanager
def _ready_on_bench(order: FlightOrder, address: str) -> Iterator[tuple[Campaign, FlyingSettings]]:
    """Prepare a flight on a bench of a cluster; the bench is locked by its own server."""
    require_writable(order.out, junit=order.junit)
    with bench_flight(
        order.file,
        order.options,
        address,
        clock=order.clock,
        jobs=order.jobs,
        arm=order.arm,
        select=order.select,
        store=result_store(order.store, order.engine),
    ) as flight:
        yield flight.campaign, replace(order.settings(flight.cleared), engine=flight.engine)


def _refuse_attached(campaign: Campaign, engine: str) -> None:
    """Raise RefusedError for attached vehicles on another engine than that of this machine."""
    if attached := attached_vehicles(campaign):
        names = " and ".join(f"{one.name} ({one.attached})" for one in attached)
        raise RefusedError(
            f"--engine {engine}: {names} is attached to one machine, where consent to arm is "
            "given; fly there with --engine local",
            REFUSED,
        )


def _clear(campaign: Campaign, order: FlightOrder) -> Cleared:
    """Return the campaign cleared to run. Raises RefusedError."""
    return clear(
        campaign,
        clock=order.clock,
        jobs=order.jobs,
        arm=order.arm,
        arm_real=order.arm_real,
        arm_actors=order.arm_actors,
    )
