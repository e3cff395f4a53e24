"""`wil-campaign abort | hold | resume`: an operator's commands, by the sockets of this machine."""

import getpass
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from orchestrator.cli.standard_streams import err, out
from orchestrator.operator.campaign_records import Place, Places, places
from orchestrator.operator.socket_client import NoAnswerError, ask
from safety.guard.core.operator_command import OperatorKind

NOBODY = 3
"""The exit code when nothing flies, or nothing obeyed."""


def abort(folder: Path | None = None, *, who: str | None = None) -> int:
    """Land what flies on this machine, at once; nothing more of its campaigns is flown.

    It goes to the guards first, and works when the program that started them is dead.

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
        return None
    return flying


def _command(kind: OperatorKind, folder: Path | None, who: str | None) -> int:
    """Send an operator's command to what flies; return the exit code."""
    flying = find_campaigns(folder)
    if flying is None:
        return NOBODY
    name = f"cli:{who or account()}"
    if kind == "abort":
        answers = [_ask_sockets(one, kind, name) for one in (*flying.guards, *flying.campaigns)]
    else:
        answers = list(_by_campaigns(flying, kind, name))
    return 0 if any(answers) else NOBODY


def _by_campaigns(flying: Places, kind: OperatorKind, who: str) -> Iterable[bool]:
    """Send an operator's command to campaigns; to guards only where no campaign is left."""
    orphans = list(flying.guards)
    for campaign in flying.campaigns:
        own = flying.guards_of(campaign)
        try:
            yield _describe_answers(campaign, ask(campaign.socket, kind, who=who))
        except NoAnswerError as error:
            err(error)
        else:
            orphans = [one for one in orphans if one not in own]
    for guard in orphans:
        yield _ask_sockets(guard, kind, who)


def _ask_sockets(place: Place, kind: OperatorKind, who: str) -> bool:
    """Send an operator's command to a socket; return whether it was executed."""
    try:
        return _describe_answers(place, ask(place.socket, kind, who=who))
    except NoAnswerError as error:
        err(error)
        return False


def _describe_answers(place: Place, answer: dict[str, Any]) -> bool:
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
