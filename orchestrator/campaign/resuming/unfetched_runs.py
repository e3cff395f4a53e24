"""Runs that nodes have sent to a store for a program that did not live to fetch them."""

import time
import uuid
from collections.abc import Callable
from pathlib import Path

from orchestrator.campaign.folder.campaign_folder import OutputError
from orchestrator.campaign.resuming.resumption import ResumeError
from orchestrator.campaign.resuming.run_ledger import campaign_places, open_orders
from orchestrator.model.results_reader import ResultError, read_result
from orchestrator.storage.store import Store, StoreError, StoreRefusedError, open_store
from orchestrator.storage.stored_runs import RESULT_FILE, await_run, write_session

_LANDED_S = 120.0
"""How long a run of a program that was killed may take to land and to be sent."""
_BEGUN_S = 5.0
"""How long an order that was on its way may take to begin; after that the store refuses it."""


def fetch_stored_runs(folder: Path, *, say: Callable[[str], None]) -> None:
    """Have no earlier start fly any more, and fetch what its nodes have sent to its store.

    What the ledger has as ordered and the folder has no result of is waited for until it has
    landed. Raises ResumeError, OutputError, OSError.
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
            say(f"{order.run}: looking for it in {place.store}/{order.place}")
            why = await_run(
                stores[place.store],
                order.place,
                home,
                landed_s=max(0.0, due_s - time.monotonic()),
                begun_s=_BEGUN_S,
            )
            if why:
                say(f"{order.run}: {why}")
    except StoreRefusedError as error:
        raise ResumeError(f"{folder} has runs in a store: {error}") from error
    except StoreError as error:
        raise OutputError(
            f"finished runs may be in the store, and are not fetched: {error}; resume again when "
            "the store answers"
        ) from error


def _has_result(home: Path) -> bool:
    try:
        read_result(home / RESULT_FILE)
    except ResultError:
        return False
    return True
