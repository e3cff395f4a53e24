"""An operator's command, in one form from the channel that receives it to the guard."""

from dataclasses import dataclass
from typing import Literal

OperatorKind = Literal["abort", "hold", "resume", "geofence"]


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """An operator's command: its kind, who gave it ("Ctrl-C", "mqtt:anna"), and why, for the log.

    document: for geofence, the new fences as text of YAML, a plan or GeoJSON. command_id: names
    the command in a delayed answer. node, bench: for abort, the place whose runs are aborted. run:
    "case/mode/repetition" of the only run that the command is for; an abort lands the others, too.
    """

    kind: OperatorKind
    who: str
    reason: str = ""
    document: str = ""
    command_id: str = ""
    node: str = ""
    bench: str = ""
    run: str = ""

    @property
    def is_partial(self) -> bool:
        """Return whether the command concerns the runs of one node or bench only."""
        return bool(self.node or self.bench)

    def is_for(self, run: str) -> bool:
        """Return whether the command is for a run, by the run's name."""
        return self.kind == "abort" or self.run in {"", run}
