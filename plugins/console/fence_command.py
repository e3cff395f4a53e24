"""`wil-campaign fence`: sends new fences to the vehicles of a campaign in flight."""

import secrets
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from wil_campaign.orchestrator.cli.commands.operate import All, account, who_option
from wil_campaign.orchestrator.cli.flight_choice import NONE_OBEYED, TypedCommand, choose_flights
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace
from wil_campaign.orchestrator.operator.socket_client import NoAnswerError, ask_operator_socket
from wil_campaign.safety.guard.operator.operator_lines import LONGEST_LINE_BYTES

_ANSWERS_S = 60.0
"""Half of this for an upload over a bad radio, half for restoring the old fence."""
_POLL_S = 0.1
_LONGEST_FILE_BYTES = LONGEST_LINE_BYTES // 2
"""The text grows when it is written as JSON, and the line has to fit."""


def fence(
    file: Path, folder: Path | None = None, *, all_: All = False, who: str | None = None
) -> int:
    """Send new fences to the vehicles of a campaign in flight, for the rest of their runs.

    Every vehicle must be inside its new fence and able to stop there, and every autopilot must
    accept it; otherwise nothing changes. Where several campaigns are in the air they are listed
    and nothing is sent: exit code 2.

    Parameters
    ----------
    file
        A `geofence` as in a campaign, a QGroundControl .plan, Mission Planner's .waypoints, or
        GeoJSON; the last three keep the floor and ceiling of the present fences.
    folder
        The campaign's folder; needed where several are in the air.
    all_
        All campaigns in the air on this machine, or beneath the folder: each gets this fence.
    who
        Your name, for the record; by default that of your account.
    """
    try:
        with file.open("rb") as opened:  # /dev/zero has no end
            content = opened.read(_LONGEST_FILE_BYTES + 1)
        document = content.decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        write_stderr(f"{file} cannot be read: {error}")
        return 2
    if len(content) > _LONGEST_FILE_BYTES:
        write_stderr(f"{file} has more than {_LONGEST_FILE_BYTES} bytes")
        return 2
    typed = TypedCommand("change the fence of", ("fence", str(file)), who_option(who))
    flying = choose_flights(folder, typed, is_all=all_)
    if isinstance(flying, int):
        return flying
    by = f"cli:{who or account()}"
    orphans = [
        guard
        for places in flying.by_campaign().values()
        if not places.campaigns
        for guard in places.guards
    ]
    for guard in orphans:
        write_stderr(
            f"{guard.name}: its program has ended; its guard keeps the present fence, and lands"
        )
    with ThreadPoolExecutor(max(1, len(flying.campaigns))) as threads:
        asked = threads.map(lambda one: _change_fences(one, document, by), flying.campaigns)
        answers = list(asked)
    return 0 if answers and all(answers) and not orphans else NONE_OBEYED


def _change_fences(campaign: OperatorPlace, document: str, who: str) -> bool:
    """Ask a campaign to change fences, print its runs' replies; return whether all did.

    A run that ends before it answers needs no fence; but one run at least must have taken it.
    """
    command_id = secrets.token_hex(8)
    try:
        answer = ask_operator_socket(
            campaign.socket, "geofence", who=who, geofence=document, id=command_id
        )
        if answer.get("ok") is not True:
            write_stderr(f"{campaign.name}: {answer.get('text', '')}")
            return False
        waiting = set(answer["flying"])
        obeyed, is_answered = True, False
        ended: list[str] = []
        give_up_s = time.monotonic() + _ANSWERS_S
        while waiting and time.monotonic() < give_up_s:
            time.sleep(_POLL_S)
            status = ask_operator_socket(campaign.socket, "status", who=who)
            for reply in status["answers"]:
                if reply["id"] == command_id and reply["run"] in waiting:
                    waiting.discard(reply["run"])
                    is_answered = True
                    obeyed = obeyed and reply["ok"]
                    (write_stdout if reply["ok"] else write_stderr)(
                        f"{reply['run']}: {reply['text']}"
                    )
            for run in sorted(waiting - set(status["flying"])):
                waiting.discard(run)
                ended.append(run)
    except NoAnswerError as error:
        write_stderr(error)
        return False
    for run in sorted(waiting):
        write_stderr(f"{run}: no answer within {_ANSWERS_S:g} s")
    for run in ended if is_answered or waiting else ():
        write_stderr(
            f"{run}: ended before it answered: whether its vehicles got the fence is not known"
        )
    if not waiting and not is_answered:
        write_stderr(
            f"{campaign.name}: no run confirmed the fence: each ended before it answered; send the "
            "fence again when a run is in flight (`wil-campaign watch` shows them)"
        )
    return obeyed and is_answered and not waiting
