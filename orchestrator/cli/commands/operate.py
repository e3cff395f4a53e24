"""`wil-campaign abort | hold | resume`: an operator's commands, by the sockets of this machine."""

import getpass
import os
import signal
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from orchestrator.cli.standard_streams import err, out
from orchestrator.operator.campaign_records import Place, Places, places
from orchestrator.operator.socket_client import NoAnswerError, ask
from safety.guard.core.operator_command import OperatorKind
from safety.guard.process.runtime_folder import unsafe_folders

NOBODY = 3
"""The exit code when nothing flies, or nothing obeyed."""


def abort(folder: Path | None = None, *, who: str | None = None) -> int:
    """Land what flies on this machine, at once; nothing more of its campaigns is flown.

    It goes to all guards and campaigns at once, and works when the program that started them is
    dead. A process whose socket does not answer gets SIGTERM, on which it lands as well.

    Parameters
    ----------
    folder
        Only what writes its results there: a campaign's or a run's folder.
    who
        Your name, for the record; by default that of your account.
    """
    return _command("abort", folder, who)


def hold(folder: Path | None = None, *, who: str | None = None) -> int:
    """Have what flies stop and stay in the air, and begin no new run, until `resume`.

    A run that is held after its goal was given is INVALID.

    Parameters
    ----------
    folder
        Only what writes its results there: a campaign's or a run's folder.
    who
        Your name, for the record; by default that of your account.
    """
    return _command("hold", folder, who)


def resume(folder: Path | None = None, *, who: str | None = None) -> int:
    """Let what is held fly on.

    Parameters
    ----------
    folder
        Only what writes its results there: a campaign's or a run's folder.
    who
        Your name, for the record; by default that of your account.
    """
    return _command("resume", folder, who)


def find_campaigns(folder: Path | None) -> Places | None:
    """Return what flies, for an operator's command; None, after a message, when nothing does."""
    try:
        flying = places().beneath(folder)
    except OSError as error:
        err(error)
        return None
    if not flying.campaigns and not flying.guards:
        err(
            "no campaign is in flight on this machine"
            if folder is None
            else f"no run is in flight in {folder}"
        )
        for text in unsafe_folders():
            err(f"{text}: it was not searched")
        return None
    return flying


def _command(kind: OperatorKind, folder: Path | None, who: str | None) -> int:
    """Send an operator's command to what flies; return the exit code."""
    flying = find_campaigns(folder)
    if flying is None:
        return NOBODY
    name = f"cli:{who or account()}"
    answers = _abort(flying, name) if kind == "abort" else list(_to_campaigns(flying, kind, name))
    return 0 if any(answers) else NOBODY


def _abort(flying: Places, who: str) -> list[bool]:
    """Ask all sockets at once, so that none which hangs delays another; then signal those."""
    everyone = (*flying.guards, *flying.campaigns)
    with ThreadPoolExecutor(len(everyone)) as threads:
        answers = list(threads.map(lambda one: _send_to_socket(one, "abort", who), everyone))
    for place, obeyed in zip(everyone, answers, strict=True):
        if not obeyed:
            _signal(place)
    return answers


def _signal(place: Place) -> None:
    """Send SIGTERM to a campaign or a guard: both take it as an order to land."""
    process = place.process
    if process is None or not process.lives:
        return
    try:
        os.kill(process.pid, signal.SIGTERM)
    except OSError as error:
        err(f"{place.name}: SIGTERM cannot be sent to process {process.pid}: {error.strerror}")
        return
    err(f"{place.name}: SIGTERM is sent to process {process.pid}; watch shows whether it lands")


def _to_campaigns(flying: Places, kind: OperatorKind, who: str) -> Iterable[bool]:
    """Send an operator's command to campaigns; to guards only where no campaign is left."""
    orphans = list(flying.guards)
    for campaign in flying.campaigns:
        own = flying.guards_of(campaign)
        try:
            yield _print_reply(campaign, ask(campaign.socket, kind, who=who))
        except NoAnswerError as error:
            err(error)
        else:
            orphans = [one for one in orphans if one not in own]
    for guard in orphans:
        yield _send_to_socket(guard, kind, who)


def _send_to_socket(place: Place, kind: OperatorKind, who: str) -> bool:
    """Send an operator's command to a socket; return whether it was executed."""
    try:
        return _print_reply(place, ask(place.socket, kind, who=who))
    except NoAnswerError as error:
        err(error)
        return False


def _print_reply(place: Place, answer: dict[str, Any]) -> bool:
    """Print the reply to an operator's command; return whether it was executed."""
    obeyed = answer.get("ok") is True
    (out if obeyed else err)(f"{place.name}: {answer.get('text', '')}")
    return obeyed


def account() -> str:
    """Return the login name of the operator."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "operator"
