"""Messages between a program and the process that flies its campaign: lines of JSON."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.campaign.flight_options import FlightOptions
from wil_campaign.orchestrator.cli.run_selection import RunSelection
from wil_campaign.orchestrator.run_results.run_result import RunResult


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRequest:
    """A request to fly the selected runs of a campaign file."""

    file: Path
    choice: RunSelection
    options: FlightOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFinished:
    """A run or control has its verdict."""

    result: RunResult
    kind: Literal["run finished"] = "run finished"


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignMessage:
    """A sentence about the campaign for people."""

    text: str
    kind: Literal["message"] = "message"


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignEnded:
    """The campaign is over, and its results are in the folder. exit_code: as of `run`."""

    folder: str
    exit_code: int
    kind: Literal["ended"] = "ended"


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignRefused:
    """The campaign cannot be flown: why, with the exit code of `run`."""

    text: str
    exit_code: int
    kind: Literal["refused"] = "refused"


FlightMessage = RunFinished | CampaignMessage | CampaignEnded | CampaignRefused


@cache
def _request_model() -> TypeAdapter[FlightRequest]:
    return TypeAdapter(FlightRequest)


@cache
def _message_model() -> TypeAdapter[FlightMessage]:
    return TypeAdapter(Annotated[FlightMessage, Field(discriminator="kind")])


def encode_request(request: FlightRequest) -> bytes:
    """Return a request as a line. Raises ValueError for what JSON has no word for."""
    return _request_model().dump_json(request) + b"\n"


def encode_line(message: FlightMessage) -> bytes:
    """Return a message as a line."""
    return to_json(message, indent=None).encode("utf-8", "backslashreplace")


def decode_request(line: bytes) -> FlightRequest:
    """Return the request in a line. Raises ValueError."""
    return _request_model().validate_json(line)


def decode_message(line: bytes) -> FlightMessage:
    """Return the message in a line. Raises ValueError."""
    return _message_model().validate_json(line)
