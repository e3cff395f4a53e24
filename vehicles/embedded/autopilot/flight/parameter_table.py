"""The table of an autopilot's parameters, and their encodings by PX4 and by ArduPilot."""

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.known_parameters import (
    parameter_rows,
    unused_rows,
)

_KINDS = {
    "int8": mavlink.MAV_PARAM_TYPE_INT8,
    "int16": mavlink.MAV_PARAM_TYPE_INT16,
    "int32": mavlink.MAV_PARAM_TYPE_INT32,
    "float": mavlink.MAV_PARAM_TYPE_REAL32,
}
_BYTEWISE_FORMATS = {mavlink.MAV_PARAM_TYPE_INT32: "<i", mavlink.MAV_PARAM_TYPE_REAL32: "<f"}
_BITS = {
    mavlink.MAV_PARAM_TYPE_INT8: 8,
    mavlink.MAV_PARAM_TYPE_INT16: 16,
    mavlink.MAV_PARAM_TYPE_INT32: 32,
}
_REAL32: int = mavlink.MAV_PARAM_TYPE_REAL32


class TableParameter(NamedTuple):
    """A parameter in the table: its MAV_PARAM_TYPE, and its value as a number."""

    name: str
    kind: int
    value: float


class ParameterTable:
    """The emulated autopilot's parameter table, in the order of names.

    bytewise: PX4's convention, where an integer's bits travel in the float field; otherwise
    ArduPilot's, where the value is cast to float. unused: those that nothing acts on, with the
    value that is flown by, if there is one.
    """

    def __init__(
        self,
        table: tuple[TableParameter, ...],
        *,
        bytewise: bool,
        unused: Mapping[str, float | None] = MappingProxyType({}),
    ) -> None:
        self._unused = unused
        self._defaults = {entry.name: entry.value for entry in table}
        self._entries = {entry.name: entry for entry in sorted(table)}
        self._names = tuple(self._entries)
        self._bytewise = bytewise
        self.changes = 0
        """Number of times that a parameter was set."""

    def __getitem__(self, name: str) -> float:
        return self._entries[name].value

    def __contains__(self, name: str) -> bool:
        return name in self._entries

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def kind(self, name: str) -> int:
        """Return a parameter's MAV_PARAM_TYPE."""
        return self._entries[name].kind

    def is_whole(self, name: str) -> bool:
        """Return whether a parameter is an integer."""
        kind = self._entries[name].kind
        return kind != _REAL32

    def is_in_vain(self, name: str) -> bool:
        """Return whether a parameter has a value that nothing acts on, and that is not usual."""
        usual = (self._unused.get(name), self._defaults[name])
        return name in self._unused and self._entries[name].value not in usual

    def index(self, name: str) -> int:
        """Return a parameter's index in the table."""
        return self._names.index(name)

    def name_at(self, index: int) -> str | None:
        """Return the parameter name at an index of the table; None beyond its end."""
        return self._names[index] if 0 <= index < len(self._names) else None

    def set(self, name: str, value: float) -> None:
        """Set a parameter; integers drop their fraction and stay in range.

        Raises KeyError for an unknown name.
        """
        entry = self._entries[name]
        bits = _BITS.get(entry.kind)
        if bits is not None:
            value = float(int(max(-(2.0 ** (bits - 1)), min(2.0 ** (bits - 1) - 1.0, value))))
        self._entries[name] = entry._replace(value=value)
        self.changes += 1

    def to_wire(self, name: str) -> float:
        """Return a parameter's value as transmitted in a float field."""
        entry = self._entries[name]
        if not self._bytewise or entry.kind == mavlink.MAV_PARAM_TYPE_REAL32:
            return entry.value
        return float(struct.unpack("<f", struct.pack("<i", int(entry.value)))[0])

    def from_wire(self, kind: int, value: float) -> float:
        """Return the parameter value in a float field of this MAV_PARAM_TYPE."""
        if not self._bytewise or kind == mavlink.MAV_PARAM_TYPE_REAL32:
            return value
        return float(struct.unpack(_BYTEWISE_FORMATS[kind], struct.pack("<f", value))[0])


def load_parameters(
    file: Path, *, bytewise: bool, overrides: Mapping[str, float]
) -> ParameterTable:
    """Return the parameter table of a YAML file (`NAME: [kind, value]`), some replaced.

    Raises ValueError for an override that the table does not have.
    """
    rows = parameter_rows(file)
    table = tuple(TableParameter(name, _KINDS[kind], value) for name, (kind, value) in rows.items())
    parameters = ParameterTable(table, bytewise=bytewise, unused=unused_rows(file))
    unknown = [name for name in overrides if name not in parameters]
    if unknown:
        raise ValueError(f"the autopilot has no parameter {', '.join(sorted(unknown))}")
    for name, value in overrides.items():
        parameters.set(name, value)
    return parameters
