"""What an operator asks, the same from the way it came to the guard that follows it."""

from dataclasses import dataclass
from typing import Literal

OperatorKind = Literal["abort", "hold", "resume", "geofence"]


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """An operator's command: what, who ("Ctrl-C", "mqtt:anna"), and for the record why.

    document: for geofence, what the new fences are: the text of YAML, a plan or GeoJSON.
    command_id: by which it is answered, where the answer takes time.
    """

    kind: OperatorKind
    who: str
    reason: str = ""
    document: str = ""
    command_id: str = ""
