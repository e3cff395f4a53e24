"""An operator's command, in one form from the channel that receives it to the guard."""

from dataclasses import dataclass
from typing import Literal

OperatorKind = Literal["abort", "hold", "resume", "geofence"]


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """An operator's command: its kind, who gave it ("Ctrl-C", "mqtt:anna"), and why, for the log.

    document: for geofence, the new fences as text of YAML, a plan or GeoJSON. command_id: names
    the command in a delayed answer. node, bench: for abort, the place whose runs are aborted.
    """

    kind: OperatorKind
    who: str
    reason: str = ""
    document: str = ""
    command_id: str = ""
    node: str = ""
    bench: str = ""

    @property
    def is_partial(self) -> bool:
        """Return whether the command concerns the runs of one node or bench only."""
        return bool(self.node or self.bench)
