"""Prepares `run` on a bench of a cluster: reserves the bench and gets consent to arm there."""

import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions
from wil_campaign.campaigns.schema.bench import BenchRequestPart
from wil_campaign.foundation.files.documents import Document
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import require_writable_results
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from wil_campaign.orchestrator.cli.arming_consent import REFUSED, FlightRefusedError, user_name
from wil_campaign.orchestrator.cli.clock_choice import campaign_clock_for
from wil_campaign.orchestrator.cli.engine_flight import load_selected
from wil_campaign.orchestrator.cli.standard_streams import write_stderr
from wil_campaign.plugins.cluster.bench.bench_engine import HiredBench, bench_of_cluster
from wil_campaign.plugins.cluster.cluster_engine import results_store, store_of_results
from wil_campaign.plugins.cluster.node_messages import ConsentAsked
from wil_campaign.plugins.cluster.ray_engine import engine_address


@contextmanager
def ready_on_bench(
    file: Path,
    selection: ExpansionOptions,
    options: FlightOptions,
    document: Document,
    request: BenchRequestPart,
) -> Iterator[tuple[Campaign, ClearedCampaign]]:
    """Reserve the bench that a campaign requests, and get consent there; release it at the end.

    document: the campaign's. The bench is locked by its own server. Raises BadInput, OutputError,
    RefusedError, EngineError.
    """
    address = engine_address(options.engine)
    if address is None:
        raise FlightRefusedError(
            "--engine ray: a Ray of this machine alone has no benches; use --engine "
            "ray://HOST:PORT, or --bench-file FILE for a bench of this machine",
            REFUSED,
        )
    require_writable_results(options.out, junit=options.junit)
    store = store_of_results(options.store) if options.store else None
    if options.clock not in {None, "wall"} or options.jobs not in {None, 1}:
        raise FlightRefusedError(
            "a bench flies one run at a time, on the wall clock; leave --clock and --jobs out",
            REFUSED,
        )
    with (
        results_store(store, address) as through,
        bench_of_cluster(address, document, request, write_stderr) as hired,
    ):
        here = replace(selection, benches=(hired.bench,))
        campaign = load_selected(file, here, options)
        campaign_clock_for(campaign, "wall")
        others = [
            attached_vehicle
            for attached_vehicle in attached_vehicles(campaign)
            if attached_vehicle.name != "real"
        ]
        if others:
            names = " and ".join(f"{flown.name} ({flown.attached})" for flown in others)
            raise FlightRefusedError(f"{names}: a bench has one vehicle, the real one", REFUSED)
        cleared = _clear_at_bench(campaign, hired, arm=options.arm)
        yield campaign, replace(cleared, engine=hired.engine(through))


def _clear_at_bench(campaign: Campaign, hired: HiredBench, *, arm: bool) -> ClearedCampaign:
    """Return a campaign cleared by the person at its bench. Raises RefusedError, EngineError."""
    runs = len(campaign.plans) if arm else len(campaign.runs)
    if arm:
        write_stderr(f"waiting for consent to arm, at the terminal of bench {hired.bench.name}")
    answer = hired.ask_consent(
        ConsentAsked(campaign.name, runs, arm, f"{user_name()} on {platform.node()}")
    )
    if answer.problem:
        raise FlightRefusedError(answer.problem, answer.code)
    write_stderr(answer.vehicle)
    return ClearedCampaign("wall", 1, answer.real_kind, answer.hardware)
