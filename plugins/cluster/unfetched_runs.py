"""Fetches runs that nodes have sent to a store after the campaign's program was killed."""

import time
import uuid
from collections.abc import Callable
from pathlib import Path

from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError
from wil_campaign.orchestrator.campaign.resuming.cluster_ledger import (
    OpenOrder,
    campaign_places,
    open_orders,
)
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import ResumeError
from wil_campaign.orchestrator.run_results.result_reader import ResultError, read_result
from wil_campaign.plugins.cluster.store import Store, StoreError, StoreRefusedError, open_store
from wil_campaign.plugins.cluster.stored_runs import (
    RESULT_FILE,
    DamagedRunError,
    await_run,
    write_session,
)

_LANDED_S = 120.0
"""How long a run of a killed program may take to land and to be sent."""
_BEGUN_S = 5.0
"""How long a sent order may take to begin; after that the store refuses it."""


def fetch_stored_runs(folder: Path, *, say: Callable[[str], None]) -> None:
    """Stop earlier starts from beginning runs, and fetch what their nodes have sent to the store.

    Waits until ordered runs without a result in the folder have landed. Raises ResumeError,
    OutputError, OSError.
    """
    places = campaign_places(folder)
    stores: dict[str, Store] = {}
    try:
        for at in places.values():
            stores[at.store] = open_store(at.store)
            write_session(stores[at.store], at.place, f"resumed-{uuid.uuid4().hex}")
        due_s = time.monotonic() + _LANDED_S
        for order in open_orders(folder).values():
            home, place = folder / order.run, places.get(order.session)
            if not order.place or place is None or _has_result(home):
                continue
            say(f"{order.run}: looking for its files in {place.store}/{order.place}")
            left_s = max(0.0, due_s - time.monotonic())
            if why := _fetch(stores[place.store], order, home, left_s):
                say(f"{order.run}: {why}")
    except StoreRefusedError as error:
        raise ResumeError(f"{folder} has runs in a store: {error}") from error
    except StoreError as error:
        raise OutputError(
            f"finished runs may be in the store and cannot be fetched: {error}; resume again when "
            "the store is reachable"
        ) from error


def _fetch(store: Store, order: OpenOrder, home: Path, landed_s: float) -> str:
    """Fetch an ordered run; return in words why it has no result here, "" where it has.

    Raises StoreError, OSError.
    """
    try:
        return await_run(store, order.place, home, landed_s=landed_s, begun_s=_BEGUN_S)
    except DamagedRunError as error:
        return f"it is lost: {error}"


def _has_result(home: Path) -> bool:
    try:
        read_result(home / RESULT_FILE)
    except ResultError:
        return False
    return True
