"""Messages between a program and the process that flies its campaign: lines of JSON."""

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from orchestrator.model.clock import Clock
from orchestrator.model.document_writer import to_json
from orchestrator.model.results import RunResult


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRequest:
    """A request to fly a campaign. runs: only these, by name; None for all."""

    file: str
    cases: tuple[str, ...]
    modes: tuple[str, ...]
    repetitions: int | None
    seed: int | None
    sets: tuple[str, ...]
    runs: tuple[str, ...] | None
    out: str
    clock: Clock | None
    jobs: int | None
    junit: str | None
    resume: bool
    arm: bool
    arm_real: bool
    arm_actors: bool
    engine: str
    store: str
    bench_files: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFinished:
    """A run or control has its verdict."""

    result: RunResult
    kind: Literal["run finished"] = "run finished"


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
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


FlightMessage = RunFinished | Message | CampaignEnded | CampaignRefused


@cache
def _request_model() -> TypeAdapter[FlightRequest]:
    return TypeAdapter(FlightRequest)


@cache
def _message_model() -> TypeAdapter[FlightMessage]:
    return TypeAdapter(Annotated[FlightMessage, Field(discriminator="kind")])


def encode_line(message: FlightRequest | FlightMessage) -> bytes:
    """Return a request or a message as a line."""
    return to_json(message, indent=None).encode("utf-8", "backslashreplace")


def decode_request(line: bytes) -> FlightRequest:
    """Return the request in a line. Raises ValueError."""
    return _request_model().validate_json(line)


def decode_message(line: bytes) -> FlightMessage:
    """Return the message in a line. Raises ValueError."""
    return _message_model().validate_json(line)
