"""`wil-campaign sign`: prints a signed operator command, ready to publish by MQTT."""

import json
import os
import secrets
import time
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from wil_campaign.orchestrator.cli.commands.operate import account
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.plugins.mqtt.message_signing import signed_command
from wil_campaign.plugins.mqtt.mqtt_channel import ACCESS, TOKEN


def sign(
    command: Literal["abort", "hold", "resume", "geofence"],
    folder: Path,
    *,
    who: str | None = None,
    reason: str = "",
    run: str | None = None,
    fence: Path | None = None,
    token_env: Annotated[str, Parameter(name="--token-env")] = "",
) -> int:
    """Print a signed command for a campaign's broker, which is valid for five seconds.

    Publish it on <topics>/operator/<command>; this program does not publish it.

    Parameters
    ----------
    command
        abort, hold, resume or geofence.
    folder
        The campaign's results folder, which has the topics and the session.
    who
        Your name, for the record; by default that of your account.
    reason
        Why, for the record.
    run
        CASE/MODE/REPETITION, if the command is for that run only; an abort is for all runs.
    fence
        The file of the new fences, for geofence.
    token_env
        The environment variable with the token, if the campaign names one; else the token of the
        folder is used.
    """
    fields: dict[str, Any] = {
        "id": secrets.token_hex(8),
        "at": time.time(),
        "who": who or account(),
    }
    try:
        access = json.loads((folder / ACCESS).read_text("utf-8"))
        topic, fields["session"] = f"{access['topics']}/operator/{command}", access["session"]
        token = os.environ.get(token_env, "") if token_env else _token(folder)
        if fence is not None:
            fields["geofence"] = fence.read_text("utf-8")
    except (OSError, ValueError, KeyError, TypeError) as error:
        write_stderr(f"{folder}: no command can be signed: {error}")
        return 2
    if not token:
        write_stderr(f"the variable {token_env} is not set")
        return 2
    fields |= {"reason": reason} if reason else {}
    fields |= {"run": run} if run is not None else {}
    write_stdout(signed_command(topic, fields, token).decode())
    return 0


def _token(folder: Path) -> str:
    return (folder / TOKEN).read_text("utf-8").strip()
