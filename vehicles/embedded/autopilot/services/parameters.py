"""Parameters: their table, their two encodings on the wire, and the protocol that serves them."""

import math
import struct
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from pymavlink.dialects.v20 import ardupilotmega as mavlink

_KINDS = {
    "int8": mavlink.MAV_PARAM_TYPE_INT8,
    "int16": mavlink.MAV_PARAM_TYPE_INT16,
    "int32": mavlink.MAV_PARAM_TYPE_INT32,
    "float": mavlink.MAV_PARAM_TYPE_REAL32,
}
_BYTEWISE_FORMATS = {mavlink.MAV_PARAM_TYPE_INT32: "<i", mavlink.MAV_PARAM_TYPE_REAL32: "<f"}
_REAL32: int = mavlink.MAV_PARAM_TYPE_REAL32
NO_INDEX = 65535
"""What ArduPilot gives as the index of a parameter that was not asked for by index."""


class Parameter(NamedTuple):
    """A parameter: its MAV_PARAM_TYPE, and its value as a number."""

    name: str
    kind: int
    value: float


class Parameters:
    """The table, in the order of names; values as plain numbers.

    bytewise: PX4's convention, where an integer's bits travel in the float field; otherwise
    ArduPilot's, where the value is cast to float.
    """

    def __init__(self, table: tuple[Parameter, ...], *, bytewise: bool) -> None:
        self._entries = {entry.name: entry for entry in sorted(table)}
        self._names = tuple(self._entries)
        self._bytewise = bytewise

    def __getitem__(self, name: str) -> float:
        return self._entries[name].value

    def __contains__(self, name: str) -> bool:
        return name in self._entries

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def kind(self, name: str) -> int:
        """Return the MAV_PARAM_TYPE."""
        return self._entries[name].kind

    def is_whole(self, name: str) -> bool:
        """Return whether it is an integer."""
        kind = self._entries[name].kind
        return kind != _REAL32

    def index(self, name: str) -> int:
        """Return the place in the list."""
        return self._names.index(name)

    def name_at(self, index: int) -> str | None:
        """Return the name at a place of the list; None beyond its end."""
        return self._names[index] if 0 <= index < len(self._names) else None

    def set(self, name: str, value: float) -> None:
        """Set a value; integers drop their fraction. Raises KeyError for an unknown name."""
        entry = self._entries[name]
        if entry.kind != mavlink.MAV_PARAM_TYPE_REAL32:
            value = float(int(value))
        self._entries[name] = entry._replace(value=value)

    def to_wire(self, name: str) -> float:
        """Return the value as it travels in a float field."""
        entry = self._entries[name]
        if not self._bytewise or entry.kind == mavlink.MAV_PARAM_TYPE_REAL32:
            return entry.value
        return float(struct.unpack("<f", struct.pack("<i", int(entry.value)))[0])

    def from_wire(self, kind: int, value: float) -> float:
        """Return the number that a float field carries for this MAV_PARAM_TYPE."""
        if not self._bytewise or kind == mavlink.MAV_PARAM_TYPE_REAL32:
            return value
        return float(struct.unpack(_BYTEWISE_FORMATS[kind], struct.pack("<f", value))[0])


def load_parameters(file: Path, *, bytewise: bool, overrides: Mapping[str, float]) -> Parameters:
    """Return the table of a YAML file (`NAME: [kind, value]`), with some values replaced.

    Raises ValueError for an override that the table does not have.
    """
    rows: dict[str, tuple[str, float]] = yaml.safe_load(file.read_text(encoding="utf-8"))
    table = tuple(
        Parameter(name, _KINDS[kind], float(value)) for name, (kind, value) in rows.items()
    )
    parameters = Parameters(table, bytewise=bytewise)
    unknown = [name for name in overrides if name not in parameters]
    if unknown:
        raise ValueError(f"the autopilot has no parameter {', '.join(sorted(unknown))}")
    for name, value in overrides.items():
        parameters.set(name, value)
    return parameters


class ParameterServer:
    """Answers PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET.

    strict: PX4's way, which refuses a PARAM_SET of the wrong type and gives the parameter's index
    in its answer; otherwise ArduPilot's.
    """

    _PER_TURN = 8
    """How many of a list go out per turn of 20 ms, so that a radio is not flooded."""

    def __init__(self, parameters: Parameters, *, strict: bool) -> None:
        self._parameters = parameters
        self._strict = strict
        self._queue: deque[str] = deque()

    def request_list(self) -> None:
        """Begin to send all of them."""
        self._queue = deque(self._parameters)

    def due(self) -> list[Any]:
        """Return the next few of a list under way."""
        count = min(self._PER_TURN, len(self._queue))
        return [self._value(self._queue.popleft(), indexed=True) for _ in range(count)]

    def read(self, message: Any) -> list[Any]:
        """Answer a PARAM_REQUEST_READ; nothing for an unknown parameter."""
        index = message.param_index
        name = self._parameters.name_at(index) if index >= 0 else message.param_id
        if name is None or name not in self._parameters:
            return []
        return [self._value(name, indexed=True)]

    def write(self, message: Any) -> list[Any]:
        """Take a PARAM_SET and return the answer: the value as it now is, or nothing."""
        name = message.param_id
        parameters = self._parameters
        if name not in parameters:
            return []
        if not self._strict or message.param_type == parameters.kind(name):
            value = parameters.from_wire(message.param_type, message.param_value)
            if math.isfinite(value):
                parameters.set(name, value)
        return [self._value(name, indexed=self._strict)]

    def _value(self, name: str, *, indexed: bool) -> Any:
        parameters = self._parameters
        return mavlink.MAVLink_param_value_message(
            name.encode(),
            parameters.to_wire(name),
            parameters.kind(name),
            len(parameters),
            parameters.index(name) if indexed else NO_INDEX,
        )
