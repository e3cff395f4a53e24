"""`wil-campaign abort | hold | resume`: an operator's commands, by the sockets of this machine."""

import getpass
from pathlib import Path

from orchestrator.cli.standard_streams import err, out
from orchestrator.operator.campaign_records import Places, places
from orchestrator.operator.local_commands import send_command
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
    is_obeyed = False
    for reply in send_command(flying, kind, f"cli:{who or account()}"):
        (out if reply.ok else err)(reply.text)
        is_obeyed = is_obeyed or reply.ok
    return 0 if is_obeyed else NOBODY


def account() -> str:
    """Return the login name of the operator."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "operator"
