"""What the machine of a campaign and the process on a node send to each other; picklable."""

import pickle
from dataclasses import dataclass

from orchestrator.campaign.workers.run_workers import WorkerLost
from orchestrator.engines.travelling_files import TravellingFiles
from orchestrator.model.results import RunResult
from orchestrator.state.run_setup import RunOrder


class DamagedMessageError(OSError):
    """Bytes between the machines of a cluster that are no message; says why."""


def read_message(content: bytes) -> object:
    """Return the message in bytes from behind the cluster's token. Raises DamagedMessageError."""
    try:
        message: object = pickle.loads(content)  # noqa: S301  # behind the cluster's token
    except Exception as error:  # whatever damage makes of a pickle
        said = f"{type(error).__name__}: {error}"
        raise DamagedMessageError(f"{len(content)} bytes cannot be read: {said}") from error
    return message


def read_facts(content: bytes) -> dict[str, str]:
    """Return a node's facts, the first that it says. Raises DamagedMessageError."""
    facts = read_message(content)
    if not isinstance(facts, dict) or not isinstance(facts.get("node"), str):
        raise DamagedMessageError(f"{len(content)} bytes are not the facts of a node")
    return facts


@dataclass(frozen=True, slots=True)
class CampaignBrought:
    """A campaign comes to a node. folder: of its results, absolute, and the same on every node.

    session: which start of the campaign this is, as the ledger in that folder says. store: the URL
    to which results go instead, where the folder is not shared; place: the campaign's in it.
    """

    folder: str
    session: str
    files: TravellingFiles
    store: str = ""
    place: str = ""


@dataclass(frozen=True, slots=True)
class CampaignAnswer:
    """The node has unpacked the campaign; problem: why it cannot fly it, "" where it can."""

    problem: str = ""


@dataclass(frozen=True, slots=True)
class RunOrdered:
    """A run is to be flown on the node. place: its own in the store, where there is one."""

    order: RunOrder
    place: str = ""


@dataclass(frozen=True, slots=True)
class RunSending:
    """A node sends the files of a run to the store. files: how many it has sent so far."""

    files: int


@dataclass(frozen=True, slots=True)
class RunTaken:
    """The campaign's machine has done with a run in the store. is_there: it has all of its files.

    place: the run's in the store.
    """

    place: str
    is_there: bool


@dataclass(frozen=True, slots=True)
class RunEnded:
    """A run on the node has ended. sha256: of its result.json; "" where it wrote none.

    end_text: what was wrong with the end of its process. kept: where the node has its files, until
    it hears RunTaken; "" where the folder is shared.
    """

    outcome: RunResult | WorkerLost
    sha256: str = ""
    end_text: str = ""
    kept: str = ""
