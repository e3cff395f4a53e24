"""Types of ROS 2 messages by rosbags: their classes, hashes and CDR; no ROS is needed."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from wil_campaign.plugins.ros2.messages.trigger import TRIGGER, TRIGGER_HASH

DISTRIBUTIONS = {
    "humble": Stores.ROS2_HUMBLE,
    "iron": Stores.ROS2_IRON,
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
}
_NO_HASH = "TypeHashNotSupported"
"""What rmw_zenoh of humble, whose types have no hash, has in its place."""


_ZEROS: Mapping[object, float | bool] = {"bool": False, "float32": 0.0, "float64": 0.0}
"""Of types of numbers that are no integers."""


class BadRosMessageError(Exception):
    """The bytes of a message are not those of its type; the message says why."""


class BadDefinitionError(Exception):
    """The text of a message's definition cannot be read; the message says which."""


class RosTypes:
    """The message types of a distribution of ROS 2; a type is named "sensor_msgs/msg/Image".

    definitions: texts of further types, by name. Raises BadDefinitionError.
    """

    def __init__(self, distribution: str, definitions: Mapping[str, str] | None = None) -> None:
        self._store = get_typestore(DISTRIBUTIONS[distribution])
        self._hashed = distribution != "humble"
        for name, text in (definitions or {}).items():
            try:
                self._store.register(get_types_from_msg(text, name))
            except Exception as error:  # whatever a text of others makes of the parser
                reason = " ".join(str(error).split())
                raise BadDefinitionError(f"the definition of {name} is none: {reason}") from error

    def cls(self, name: str) -> Callable[..., Any]:
        """Return the class of a type: its arguments are the fields."""
        found: Callable[..., Any] = self._store.types[name]
        return found

    def has_field(self, name: str, field: str) -> bool:
        """Return whether a type has a field in this distribution."""
        return field in self._store.types[name].__dataclass_fields__

    def constant(self, name: str, constant: str) -> int:
        """Return a constant of a type; 0 where it has none of that name."""
        return int(getattr(self._store.types[name], constant, 0))

    def zero(self, name: str) -> Any:
        """Return a message of numbers, and arrays of fixed length of them, which are all 0."""
        return self._store.types[name](
            *(
                np.zeros(of[1], of[0][1][0]) if kind == Nodetype.ARRAY else _ZEROS.get(of[0], 0)
                for _, (kind, of) in self._store.fielddefs[name][1]
            )
        )

    def serialize(self, message: Any, name: str) -> bytes:
        """Return a message as CDR, little-endian."""
        return bytes(self._store.serialize_cdr(message, name))

    def deserialize(self, data: bytes, name: str) -> Any:
        """Return the message of CDR. Raises BadMessageError."""
        try:
            return self._store.deserialize_cdr(data, name)
        except Exception as error:  # whatever bytes of others make of it
            raise BadRosMessageError(f"is no {name}: {type(error).__name__}: {error}") from error

    def hash(self, name: str) -> str:
        """Return the hash of a type's definition (REP 2016)."""
        if not self._hashed:
            return _NO_HASH
        return TRIGGER_HASH if name == TRIGGER else self._store.hash_rihs01(name)

    def definition(self, name: str) -> str:
        """Return the text of a type's definition and of those it contains, as bags have it."""
        text: str = self._store.generate_msgdef(name, ros_version=2)[0]
        return text


@cache
def ros_types(distribution: str) -> RosTypes:
    """Return the types of a distribution; reading them takes 0.3 s."""
    return RosTypes(distribution)


def dds_name(name: str) -> str:
    """Return a type's name as DDS and rmw_zenoh have it: "sensor_msgs::msg::dds_::Image_"."""
    package, _, rest = name.partition("/")
    kind, _, word = rest.partition("/")
    return f"{package}::{kind}::dds_::{word}_"


def ros_name(dds: str) -> str:
    """Return a type's name of its name of DDS; the same text where it is none."""
    parts = dds.split("::")
    if len(parts) != 4 or parts[2] != "dds_":
        return dds
    return f"{parts[0]}/{parts[1]}/{parts[3].removesuffix('_')}"
