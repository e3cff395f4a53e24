"""`wil-campaign abort | hold | resume`: operator commands over the local operator sockets."""

import getpass
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.orchestrator.cli.flight_choice import (
    NONE_OBEYED,
    TypedCommand,
    choose_flights,
    list_flights,
    new_flights,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.operator.acknowledgements import WITHIN_S, runs_with_places_text
from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace, OperatorPlaces
from wil_campaign.orchestrator.operator.local_commands import (
    CommandReply,
    abort_place,
    commanded_campaigns,
    send_command,
    unconfirmed_places,
    unconfirmed_texts,
)
from wil_campaign.orchestrator.operator.socket_client import NoAnswerError, ask_operator_socket
from wil_campaign.safety.guard.core.operator_command import OperatorKind

_POLL_S = 0.1


All = Annotated[bool, Parameter(name="--all", negative=())]


def abort(
    folder: Path | None = None,
    *,
    all_: All = False,
    node: str | None = None,
    bench: str | None = None,
    who: str | None = None,
) -> int:
    """Land all vehicles of a campaign at once, and end it.

    The command goes to all its guards and to its program at once, and works even when that program
    has died. A process whose socket does not answer gets SIGTERM, on which it lands as well. Where
    several campaigns are in the air they are listed and nothing is sent: exit code 2.

    Parameters
    ----------
    folder
        The campaign's folder; needed where several are in the air.
    all_
        All campaigns in the air on this machine, or beneath the folder: for an emergency.
    node
        Only the runs on this node of a cluster: they land, nothing more is flown there, and the
        campaign continues elsewhere.
    bench
        Only the runs on this bench of a cluster.
    who
        Your name, for the record; by default that of your account.
    """
    if node is None and bench is None:
        return _command("abort", "land", folder, who, is_all=all_)
    at_node = () if node is None else ("--node", node)
    at_bench = () if bench is None else ("--bench", bench)
    typed = TypedCommand("land those runs of", ("abort",), (*at_node, *at_bench, *who_option(who)))
    flying = choose_flights(folder, typed, is_all=all_)
    if isinstance(flying, int):
        return flying
    replies = abort_place(flying, f"cli:{who or account()}", node=node or "", bench=bench or "")
    shown = _show(replies)
    return _check(shown, commanded_campaigns(flying, shown))


def hold(folder: Path | None = None, *, all_: All = False, who: str | None = None) -> int:
    """Make all vehicles of a campaign hold their position, and start no run, until `resume`.

    A run that is held after its goal was given is INVALID. Where several campaigns are in the air
    they are listed and nothing is sent: exit code 2.

    Parameters
    ----------
    folder
        The campaign's folder; needed where several are in the air.
    all_
        All campaigns in the air on this machine, or beneath the folder.
    who
        Your name, for the record; by default that of your account.
    """
    return _command("hold", "hold", folder, who, is_all=all_)


def resume(folder: Path | None = None, *, all_: All = False, who: str | None = None) -> int:
    """Resume the runs of a campaign that are held.

    Where several campaigns are in the air they are listed and nothing is sent: exit code 2.

    Parameters
    ----------
    folder
        The campaign's folder; needed where several are in the air.
    all_
        All campaigns in the air on this machine, or beneath the folder.
    who
        Your name, for the record; by default that of your account.
    """
    return _command("resume", "resume", folder, who, is_all=all_)


def _command(
    kind: OperatorKind, verb: str, folder: Path | None, who: str | None, *, is_all: bool
) -> int:
    """Send an operator's command to the chosen flights; return the exit code.

    With --all it goes to what begins meanwhile as well, until nothing new is found.
    """
    typed = TypedCommand(verb, (kind,), who_option(who))
    chosen = choose_flights(folder, typed, is_all=is_all)
    if isinstance(chosen, int):
        return chosen
    commanded, replies = chosen, _show(send_command(chosen, kind, f"cli:{who or account()}"))
    while is_all:
        more = new_flights(folder, commanded)
        if more is None:
            return NONE_OBEYED
        if not more.campaigns and not more.guards:
            break
        replies += _show(send_command(more, kind, f"cli:{who or account()}"))
        commanded |= more
    return _check(replies, commanded)


def _show(replies: Iterable[CommandReply]) -> list[CommandReply]:
    """Print the replies to a command as they come; return them."""
    shown = []
    for reply in replies:
        (write_stdout if reply.ok else write_stderr)(reply.text)
        shown.append(reply)
    return shown


def _check(replies: list[CommandReply], flying: OperatorPlaces) -> int:
    """Print which runs acknowledge a command, and which flights do not; return the exit code."""
    obeying = {reply.place for reply in replies if reply.ok}
    if not obeying:
        return NONE_OBEYED
    missing = unconfirmed_places(flying, replies)
    for text in unconfirmed_texts(missing, flying, replies):
        write_stderr(text)
    late = [
        campaign
        for campaign in flying.campaigns
        if campaign in obeying and not _is_acknowledged(campaign)
    ]
    return NONE_OBEYED if missing or late else 0


def _is_acknowledged(campaign: OperatorPlace) -> bool:
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
        write_stderr(
            f"{campaign.name}: it does not answer any more: whether its runs have acknowledged the "
            "command is not known; `wil-campaign watch` shows them"
        )
        return False
    if found.get("by"):
        write_stdout(f"{campaign.name}: acknowledged by {runs_with_places_text(found['by'])}")
    if found.get("waiting"):
        write_stderr(
            f"{campaign.name}: not acknowledged within {WITHIN_S:g} s by "
            f"{runs_with_places_text(found['waiting'])}; `wil-campaign watch` shows them"
        )
    return is_complete


def _acknowledged(campaign: OperatorPlace) -> dict[str, dict[str, str]] | None:
    """Return a campaign's acknowledgements, none of one that has ended; None without an answer."""
    try:
        found = ask_operator_socket(campaign.socket, "status", who="operator").get("acknowledged")
    except NoAnswerError:
        flying = list_flights(campaign.folder)
        return None if flying is None or campaign in flying.campaigns else {}
    return found if isinstance(found, dict) else {}


def who_option(who: str | None) -> tuple[str, ...]:
    """Return the option with the operator's name as it was typed."""
    return () if who is None else ("--who", who)


def account() -> str:
    """Return the login name of the operator."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "operator"
