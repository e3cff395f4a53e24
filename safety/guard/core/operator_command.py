"""What an operator asks, the same from the way it came to the guard that follows it."""

from dataclasses import dataclass
from typing import Literal

OperatorKind = Literal["abort", "hold", "resume", "geofence"]


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """An operator's command: what, who ("Ctrl-C", "mqtt:anna"), and for the record why.

    document: for geofence, what the new fences are: the text of YAML, a plan or GeoJSON.
    command_id: by which it is answered, where the answer takes time. node, bench: of an abort that
    is for the runs there alone.
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
        """Whether it is for the runs of one node or bench alone."""
        return bool(self.node or self.bench)
