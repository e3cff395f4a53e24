"""Polls the status of campaigns and guards on this machine through their operator sockets."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Self

from wil_campaign.foundation.files.limited_json import read_limited_json
from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace
from wil_campaign.orchestrator.operator.socket_client import NoAnswerError, ask_operator_socket
from wil_campaign.plugins.console.flight_scope import FlightScope

POLL_S = 0.5
_THREADS = 8
_MOST_ENDED = 4
_WHO = "console"


class CampaignPoller:
    """Polls the flights of a scope; a context manager."""

    def __init__(self, scope: FlightScope) -> None:
        self._scope = scope
        self._threads = ThreadPoolExecutor(_THREADS, thread_name_prefix="poll")
        self._planned: dict[Path, list[str]] = {}
        self._last: dict[Path, dict[str, Any]] = {}
        self._reasons: dict[Path, str] = {}
        self._controls: dict[Path, dict[str, bool]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)

    def poll(self) -> dict[str, Any]:
        """Return the status of all campaigns and guards; of ended ones the last status."""
        try:
            found = self._scope.places()
        except OSError as error:
            return {"campaigns": list(self._last.values()), "guards": [], "problem": str(error)}
        campaigns = list(self._threads.map(_status, found.campaigns))
        guards = list(self._threads.map(_status, found.guards))
        flying = {place.folder for place in found.campaigns}
        for place, status in zip(found.campaigns, campaigns, strict=True):
            if self._last.get(place.folder, {}).get("is_over"):
                self._forget(place.folder)  # it is resumed, and may fly runs again
            self._last[place.folder] = {
                **self._last.get(place.folder, {}),
                **status,
                "planned": self._plan(place.folder),
                "reasons": self._reasons_of(place.folder, status),
                "controls": dict(self._controls.get(place.folder, {})),
                "is_over": False,
            }
        for folder in self._last.keys() - flying:
            last = self._last[folder]
            if not last["is_over"] or "accepted" not in last:
                # Without a summary, as after a crash, the last known verdicts stay.
                last |= {"is_over": True, "flying": {}, **_summary(folder)}
        for folder in [path for path in self._last if path not in flying][:-_MOST_ENDED]:
            del self._last[folder]
        return {"campaigns": list(self._last.values()), "guards": guards, "problem": ""}

    def is_landing(self) -> bool:
        """Return whether a guard of the scope still runs."""
        try:
            return bool(self._scope.places().guards)
        except OSError:
            return False

    def _forget(self, folder: Path) -> None:
        """Forget the last status of a campaign, and the reasons of its runs."""
        del self._last[folder]
        self._controls.pop(folder, None)
        self._reasons = {
            run: why for run, why in self._reasons.items() if folder not in run.parents
        }

    def _reasons_of(self, folder: Path, status: Mapping[str, Any]) -> dict[str, str]:
        """Return the reasons of the finished runs' verdicts, from their results.

        Of controls, whether they ended as they must, is noted on the way.
        """
        found = {}
        for name in status.get("finished", {}):
            run = folder / str(name)
            if run not in self._reasons:
                result = _document(run / "result.json")
                if not result:
                    continue
                self._reasons[run] = str(result.get("reason", ""))
                if isinstance(control := result.get("control"), dict):
                    self._controls.setdefault(folder, {})[str(name)] = control.get("met") is True
            found[str(name)] = self._reasons[run]
        return found

    def _plan(self, folder: Path) -> list[str]:
        """Return the names of a campaign's runs in campaign.json."""
        if folder not in self._planned:
            runs = _document(folder / "campaign.json").get("runs")
            if not isinstance(runs, list):
                return []
            self._planned[folder] = [str(run.get("run")) for run in runs if isinstance(run, dict)]
        return self._planned[folder]


def _status(place: OperatorPlace) -> dict[str, Any]:
    """Return the status of a campaign or a guard; only its name and folder if it is silent."""
    known: dict[str, Any] = {"name": place.name, "folder": str(place.folder)}
    try:
        answer = ask_operator_socket(place.socket, "status", who=_WHO)
    except NoAnswerError as error:
        return {**known, "is_answering": False, "problem": str(error)}
    status = {key: one for key, one in answer.items() if key not in {"ok", "text", "command"}}
    return {**status, **known, "is_answering": True, "problem": ""}


def _summary(folder: Path) -> dict[str, Any]:
    """Return the verdicts of an ended campaign; empty without a readable summary."""
    found = _document(folder / "summary.json")
    if not found:
        return {}
    runs = [*_list(found, "runs"), *_list(found, "controls")]
    verdicts = {f"{run.get('case')}/{run.get('mode')}/{run.get('rep')}": run for run in runs}
    return {
        "finished": {name: str(verdict.get("verdict")) for name, verdict in verdicts.items()},
        "reasons": {name: str(verdict.get("reason", "")) for name, verdict in verdicts.items()},
        "controls": {
            name: control.get("met") is True
            for name, run in verdicts.items()
            if isinstance(control := run.get("control"), dict)
        },
        "accepted": found.get("accepted"),
    }


def _list(document: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    found = document.get(key)
    return [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []


def _document(path: Path) -> dict[str, Any]:
    """Return a JSON document of a results folder; empty if it is unreadable."""
    try:
        found = read_limited_json(path)
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
