"""Prepares `run` on a bench of a cluster: reserves the bench and gets consent to arm there."""

import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from campaigns.expansion.expansion import Campaign, Options, load_campaign, requested_bench
from orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from orchestrator.campaign.workers.run_engine import RunEngine
from orchestrator.cli.arming_consent import REFUSED, Cleared, RefusedError, user_name
from orchestrator.cli.clock_choice import clock_for
from orchestrator.cli.standard_streams import err
from orchestrator.engines.bench.bench_engine import HiredBench, bench_of_cluster
from orchestrator.engines.node_messages import ConsentAsked
from orchestrator.model.clock import Clock
from orchestrator.storage.store import Store


@dataclass(frozen=True, slots=True)
class BenchFlight:
    """A campaign that the person at its bench has consented to."""

    campaign: Campaign
    cleared: Cleared
    engine: RunEngine


def is_for_bench(file: Path, options: Options, engine: str) -> bool:
    """Return whether a campaign asks for a bench of a cluster. Raises BadInput, RefusedError.

    engine: the value of --engine, not local.
    """
    if options.benches:
        raise RefusedError(
            f"--engine {engine}: a cluster has its own benches; leave --bench-file out", REFUSED
        )
    if requested_bench(file, options) is None:
        return False
    if engine == "ray":
        raise RefusedError(
            "--engine ray: a Ray of this machine alone has no benches; use --engine "
            "ray://HOST:PORT, or --bench-file FILE for a bench of this machine",
            REFUSED,
        )
    return True


@contextmanager
def bench_flight(
    file: Path,
    options: Options,
    address: str,
    *,
    clock: Clock | None,
    jobs: int | None,
    arm: bool,
    select: Callable[[Campaign], Campaign],
    store: Store | None = None,
) -> Iterator[BenchFlight]:
    """Reserve the bench that a campaign requests, and get consent there; release it at the end.

    select: reduces the campaign to the runs to fly, for which consent is asked. store: of results.
    Raises BadInput, RefusedError, EngineError.
    """
    if clock not in {None, "wall"} or jobs not in {None, 1}:
        raise RefusedError(
            "a bench flies one run at a time, on the wall clock; leave --clock and --jobs out",
            REFUSED,
        )
    request = requested_bench(file, options)
    if request is None:
        raise ValueError(f"{file} requests no bench")
    with bench_of_cluster(address, *request, err) as hired:
        campaign = select(load_campaign(file, replace(options, benches=(hired.bench,))))
        clock_for(campaign, "wall")
        others = [one for one in attached_vehicles(campaign) if one.name != "real"]
        if others:
            names = " and ".join(f"{one.name} ({one.attached})" for one in others)
            raise RefusedError(f"{names}: a bench has one vehicle, the real one", REFUSED)
        yield BenchFlight(campaign, _clear_at_bench(campaign, hired, arm=arm), hired.engine(store))


def _clear_at_bench(campaign: Campaign, hired: HiredBench, *, arm: bool) -> Cleared:
    """Return a campaign cleared by the person at its bench. Raises RefusedError, EngineError."""
    runs = len(campaign.plans) if arm else len(campaign.runs)
    if arm:
        err(f"waiting for consent to arm, at the terminal of bench {hired.bench.name}")
    answer = hired.ask_consent(
        ConsentAsked(campaign.name, runs, arm, f"{user_name()} on {platform.node()}")
    )
    if answer.problem:
        raise RefusedError(answer.problem, answer.code)
    err(answer.vehicle)
    return Cleared("wall", 1, answer.real_kind, answer.hardware)
