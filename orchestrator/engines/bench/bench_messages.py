"""Messages between the machine of a campaign and the server of a bench, beside those of runs."""

from orchestrator.model.campaign_results import VehicleKind
from vehicles.processes.codec import Message

SOCKET_VARIABLE = "WIL_BENCH_SOCKET"
"""In the environment of the bench's node: the Unix socket of the bench's server."""
TEXT, FILE = "bench_text", "bench_file"
"""Among the facts of a bench's node: the bench file's content, and its path there."""


class ConsentAsked(Message, frozen=True):
    """A campaign requests to fly on the bench. runs: how many. arm: False for --no-arm.

    place: the machine and the user that request it.
    """

    campaign: str
    runs: int
    arm: bool
    place: str


class ConsentAnswer(Message, frozen=True):
    """The bench's answer. problem: why nothing is flown, "" where it may; code: of exit.

    real_kind: what the vehicle is. hardware: its name where it is no simulation. vehicle: the
    vehicle in words.
    """

    problem: str = ""
    code: int = 2
    real_kind: VehicleKind = "unknown"
    hardware: str = ""
    vehicle: str = ""
