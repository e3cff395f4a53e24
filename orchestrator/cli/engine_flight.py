"""Where a campaign flies, settled before it does: on this machine, a cluster, or a bench of one.

Of `run`, `search`, and programs that fly campaigns by the public module.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from campaigns.expansion.expansion import Campaign, Options, load_campaign
from orchestrator.campaign.campaign_runner import FlyingSettings, planned
from orchestrator.campaign.folder.bench_lock import held_benches
from orchestrator.campaign.folder.campaign_folder import require_writable
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
class FlightWish:
    """What is to be flown, and how, as the options of `run` say it.

    select: takes runs out of the campaign. Without arm each case and mode is tried up to arming.
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
        """Return the campaign with the runs that are wished for. Raises BadInput."""
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
def ready_flight(wish: FlightWish) -> Iterator[tuple[Campaign, FlyingSettings]]:
    """Give a campaign that may be flown, with consent where it is due, and how to fly it.

    Its engine and its bench are held until the end. Raises BadInput, OutputError, RefusedError,
    EngineError, TakenError.
    """
    if wish.engine == LOCAL:
        result_store(wish.store, wish.engine)
        with _ready_here(wish) as flight:
            yield flight
        return
    address = engine_address(wish.engine)
    is_of_bench = is_for_bench(wish.file, wish.options, wish.engine)
    ready = _ready_on_bench if is_of_bench and address is not None else _ready_over_cluster
    with ready(wish, address or "") as flight:
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
    """Have the engine that a text names; give it with how many of `runs` fly at once.

    store, jobs: as of --store and --jobs. again: further campaigns are flown by it. Raises
    EngineError.
    """
    place = result_store(store, text)
    if text == LOCAL:
        yield LocalRunEngine(), cleared.jobs
        return
    address = engine_address(text)
    # Over a cluster there is place for more than the cores of this machine.
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
            "--store: what --engine local flies is in --out already; leave --store out", 2
        )
    try:
        return open_store(url)
    except StoreRefusedError as error:
        raise EngineError(str(error), 2) from error


@contextmanager
def _ready_here(wish: FlightWish) -> Iterator[tuple[Campaign, FlyingSettings]]:
    """Have a flight in processes of this machine ready."""
    campaign = wish.load()
    start_run_server()
    require_writable(wish.out, junit=wish.junit)
    settings = wish.settings(_clear(campaign, wish))
    with held_benches(campaign.benches):
        yield campaign, settings


@contextmanager
def _ready_over_cluster(
    wish: FlightWish,
    _address: str,
) -> Iterator[tuple[Campaign, FlyingSettings]]:
    """Have a flight over the nodes of a cluster ready."""
    campaign = wish.load()
    _refuse_attached(campaign, wish.engine)
    require_writable(wish.out, junit=wish.junit)
    cleared = _clear(campaign, wish)
    settings = wish.settings(cleared)
    runs = len(planned(campaign, settings))
    with runs_engine(
        wish.engine,
        campaign,
        cleared,
        store=wish.store,
        jobs=wish.jobs,
        runs=runs,
        again=False,
    ) as (engine, at_once):
        yield campaign, replace(settings, engine=engine, jobs=at_once)


@contextmanager
def _ready_on_bench(wish: FlightWish, address: str) -> Iterator[tuple[Campaign, FlyingSettings]]:
    """Have a flight on a bench of a cluster ready; the bench is locked by its own server."""
    require_writable(wish.out, junit=wish.junit)
    with bench_flight(
        wish.file,
        wish.options,
        address,
        clock=wish.clock,
        jobs=wish.jobs,
        arm=wish.arm,
        select=wish.select,
        store=result_store(wish.store, wish.engine),
    ) as flight:
        yield flight.campaign, replace(wish.settings(flight.cleared), engine=flight.engine)


def _refuse_attached(campaign: Campaign, engine: str) -> None:
    """Raise RefusedError for attached vehicles on another engine than that of this machine."""
    if attached := attached_vehicles(campaign):
        names = " and ".join(f"{one.name} ({one.attached})" for one in attached)
        raise RefusedError(
            f"--engine {engine}: {names} is attached to one machine, where consent to arm is "
            "given; fly there with --engine local",
            REFUSED,
        )


def _clear(campaign: Campaign, wish: FlightWish) -> Cleared:
    """Return the campaign cleared to run. Raises RefusedError."""
    return clear(
        campaign,
        clock=wish.clock,
        jobs=wish.jobs,
        arm=wish.arm,
        arm_real=wish.arm_real,
        arm_actors=wish.arm_actors,
    )
