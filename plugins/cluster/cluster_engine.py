"""The engine that `--engine` names, started for a campaign that was cleared to fly."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.cli.clock_choice import shared_resources_of
from wil_campaign.orchestrator.cli.standard_streams import write_stderr
from wil_campaign.plugins.cluster.ray_engine import engine_address, ray_engine
from wil_campaign.plugins.cluster.store import Store, StoreRefusedError, open_store


@contextmanager
def cluster_engine(
    campaign: Campaign,
    options: FlightOptions,
    cleared: ClearedCampaign,
    *,
    store: Store | None,
    runs: int,
    again: bool,
) -> Iterator[ClearedCampaign]:
    """Start Ray, or join a cluster; yield the clearance to fly `runs` there.

    again: the engine flies further campaigns. Raises EngineError.
    """
    address = engine_address(options.engine)
    # A cluster has more cores than this machine.
    is_open = address is not None and options.jobs is None and not shared_resources_of(campaign)
    count = None if is_open else min(cleared.jobs, runs)
    cores = 1 if cleared.clock == "virtual" else 2
    with (
        results_store(store, address) as through,
        ray_engine(
            address, jobs=count, cores=cores, store=through, keeps_agents=again, say=write_stderr
        ) as engine,
    ):
        yield replace(cleared, engine=engine, jobs=engine.places)


@contextmanager
def results_store(store: Store | None, address: str | None) -> Iterator[Store]:
    """Yield the store for results; without --store a temporary one of this machine.

    address: of the cluster; None for a Ray of this machine alone. Raises EngineError.
    """
    if store is not None:
        yield store
    elif address is None:
        with TemporaryDirectory(prefix="wil-store-") as folder:
            yield store_of_results(Path(folder).as_uri())
    else:
        raise EngineError(
            f"--engine ray://{address}: the results of its nodes come through a store: add --store "
            "file:///FOLDER for a folder that all nodes share, else --store s3://BUCKET/PREFIX",
            2,
        )


def store_of_results(url: str) -> Store:
    """Return the store of --store. Raises EngineError for one that is refused."""
    try:
        return open_store(url)
    except StoreRefusedError as error:
        raise EngineError(str(error), 2) from error
