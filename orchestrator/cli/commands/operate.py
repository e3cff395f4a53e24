"""`wil-campaign abort | hold | resume`: operator commands over the local operator sockets."""

import getpass
import time
from collections.abc import Iterable
from pathlib import Path

from orchestrator.cli.standard_streams import err, out
from orchestrator.operator.acknowledgements import WITHIN_S, runs_text
from orchestrator.operator.campaign_records import Place, Places, places
from orchestrator.operator.local_commands import (
    CommandReply,
    abort_place,
    asked_of,
    send_command,
    unconfirmed,
    unconfirmed_texts,
)
from orchestrator.operator.socket_client import NoAnswerError, ask
from safety.guard.core.operator_command import OperatorKind
from safety.guard.process.runtime_folder import unsafe_folders

_POLL_S = 0.1
NONE_OBEYED = 3
"""The exit code when no run is in flight, or a flight does not confirm a command."""


def abort(
    folder: Path | None = None,
    *,
    node: str | None = None,
    bench: str | None = None,
    who: str | None = None,
) -> int:
    """Land all vehicles in flight on this machine at once, and end their campaigns.

    The command goes to all guards and campaigns at once, and works even when the program that
    started them has died. A process whose socket does not answer gets SIGTERM, on which it lands
    as well.

    Parameters
    ----------
    folder
        Only the campaign or run with this results folder.
    node
        Only the runs on this node of a cluster: they land, nothing more is flown there, and the
        campaign continues elsewhere.
    bench
        Only the runs on this bench of a cluster.
    who
        Your name, for the record; by default that of your account.
    """
    if node is None and bench is None:
        return _command("abort", folder, who)
    flying = find_campaigns(folder)
    if flying is None:
        return NONE_OBEYED
    replies = abort_place(flying, f"cli:{who or account()}", node=node or "", bench=bench or "")
    shown = _show(replies)
    return _check(shown, asked_of(flying, shown))


def hold(folder: Path | None = None, *, who: str | None = None) -> int:
    """Make all vehicles in flight hold their position, and start no run, until `resume`.

    A run that is held after its goal was given is INVALID.

    Parameters
    ----------
    folder
        Only the campaign or run with this results folder.
    who
        Your name, for the record; by default that of your account.
    """
    return _command("hold", folder, who)


def resume(folder: Path | None = None, *, who: str | None = None) -> int:
    """Resume the runs that are held.

    Parameters
    ----------
    folder
        Only the campaign or run with this results folder.
    who
        Your name, for the record; by default that of your account.
    """
    return _command("resume", folder, who)


def find_campaigns(folder: Path | None) -> Places | None:
    """Return the flights that a command is for; None, after a message, when there are none."""
    flying = list_flights(folder)
    if flying is None:
        return None
    if not flying.campaigns and not flying.guards:
        err(
            "no campaign is in flight on this machine"
            if folder is None
            else f"no run is in flight in {folder}"
        )
        for text in unsafe_folders():
            err(f"{text}: this folder was not searched")
        return None
    return flying


def list_flights(folder: Path | None) -> Places | None:
    """Return the flights beneath a folder, possibly none; None, after a message, on an OSError."""
    try:
        return places().beneath(folder)
    except OSError as error:
        where = "" if error.filename is None else f"{error.filename}: "
        err(
            "the records of this machine's flights cannot be read: "
            f"{where}{error.strerror or error}; check who may read this folder"
        )
        return None


def _command(kind: OperatorKind, folder: Path | None, who: str | None) -> int:
    """Send an operator's command to the flights; return the exit code."""
    flying = find_campaigns(folder)
    if flying is None:
        return NONE_OBEYED
    return _check(_show(send_command(flying, kind, f"cli:{who or account()}")), flying)


def _show(replies: Iterable[CommandReply]) -> list[CommandReply]:
    """Print the replies to a command as they come; return them."""
    shown = []
    for reply in replies:
        (out if reply.ok else err)(reply.text)
        shown.append(reply)
    return shown


def _check(replies: list[CommandReply], flying: Places) -> int:
    """Print which runs acknowledge a command, and which flights do not; return the exit code."""
    obeying = {reply.place for reply in replies if reply.ok}
    if not obeying:
        return NONE_OBEYED
    missing = unconfirmed(flying, replies)
    for text in unconfirmed_texts(missing, flying, replies):
        err(text)
    late = [one for one in flying.campaigns if one in obeying and not _is_acknowledged(one)]
    return NONE_OBEYED if missing or late else 0


def _is_acknowledged(campaign: Place) -> bool:
    """Print which runs of a campaign acknowledge the newest command; return whether all do.

    A campaign that has ended meanwhile has none in flight.
    """
    due_s = time.monotonic() + WITHIN_S
    while True:
        found = _acknowledged(campaign)
        is_complete = found is not None and not found.get("waiting")
        if is_complete or time.monotonic() > due_s:
            break
        time.sleep(_POLL_S)
    if found is None:
        err(
            f"{campaign.name}: it does not answer any more: whether its runs have acknowledged the "
            "command is not known; `wil-campaign watch` shows them"
        )
        return False
    if found.get("by"):
        out(f"{campaign.name}: acknowledged by {runs_text(found['by'])}")
    if found.get("waiting"):
        err(
            f"{campaign.name}: not acknowledged within {WITHIN_S:g} s by "
            f"{runs_text(found['waiting'])}; `wil-campaign watch` shows them"
        )
    return is_complete


def _acknowledged(campaign: Place) -> dict[str, dict[str, str]] | None:
    """Return a campaign's acknowledgements, none of one that has ended; None without an answer."""
    try:
        found = ask(campaign.socket, "status", who="operator").get("acknowledged")
    except NoAnswerError:
        flying = list_flights(campaign.folder)
        return None if flying is None or campaign in flying.campaigns else {}
    return found if isinstance(found, dict) else {}


def account() -> str:
    """Return the login name of the operator."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "operator"
