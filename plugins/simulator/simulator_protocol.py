"""The client's side of the simulator protocol: encodes requests and checks replies; pure.

docs/simulator-protocol.md is its definition. Parts of messages in, values or BadMessageError out.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from wil_campaign.plugins.readings.messagepack import BadMessageError, MessageHeader, pack_header
from wil_campaign.plugins.simulator.image_parts import (
    Buffer,
    decode_depth_part,
    decode_ids_part,
    decode_image_part,
)
from wil_campaign.plugins.simulator.shown_world import (
    AskedWorld,
    ShownWorld,
    packed_objects,
    shown_world,
)
from wil_campaign.vehicles.readings import BgrImage, DepthImage, IdImage
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

PROTOCOL = "wil/pictures/1"
"""The number rises when an old reply would be misread; keys may be added at any time."""

POSITION_TOLERANCE_M = 1e-3
QUATERNION_TOLERANCE = 1e-4
TIME_TOLERANCE_S = 1e-4
"""An echo may have been through single precision: 1 mm at 8 km, and 1e-4 s within 1000 s."""

MAX_ANSWER_PARTS = 8


@dataclass(frozen=True, slots=True)
class ImageRequest:
    """A request of the simulator protocol.

    events: times (run clock) for moving objects. moved: where these are at `t_s`, by name.
    """

    seq: int
    t_s: float
    camera_pose: Pose
    intrinsics: Intrinsics
    want_depth: bool = False
    want_ids: bool = False
    events: Mapping[str, float] = field(default_factory=dict)
    moved: Mapping[str, Pose] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedImage:
    """A simulator's image: (height, width, 3) uint8, (height, width) float32 and uint8."""

    image_bgr: BgrImage
    depth_m: DepthImage | None
    object_ids: IdImage | None


@dataclass(frozen=True, slots=True)
class SimulatorWelcome:
    """A simulator's welcome in the protocol.

    objects: names that it marks with the requested ids. shown: the world that it shows.
    """

    simulator: str
    objects: tuple[str, ...] = ()
    shown: ShownWorld = field(default_factory=ShownWorld)


class SimulatorRefusedError(BadMessageError):
    """The simulator refused a request; the message is the simulator's own."""


class LateAnswerError(BadMessageError):
    """A simulator's reply to an earlier request."""


def hello_parts(asked: AskedWorld) -> list[Buffer]:
    """Return the protocol's first message: version, the world to show, and its objects' ids."""
    greeting = {
        "protocol": PROTOCOL,
        "type": "hello",
        "world": asked.world,
        "case": asked.case,
        "objects": dict(asked.ids),
        "shapes": packed_objects(asked.objects),
    }
    return [pack_header(greeting)]


def welcome_of(parts: Sequence[Buffer]) -> SimulatorWelcome:
    """Return the simulator's welcome in its reply to hello.

    Raises RefusedError for its own refusal, BadMessageError where it breaks the protocol.
    """
    header = _header(parts)
    if header.text("type") == "error":
        raise _refused(header)
    if header.text("type") != "welcome":
        raise BadMessageError(f"`type` is {header.text('type')!r:.40}, not 'welcome'")
    objects = header.texts("objects") if "objects" in header else ()
    return SimulatorWelcome(header.text("simulator"), objects, shown_world(header))


def ask_parts(ask: ImageRequest) -> list[Buffer]:
    """Return the protocol's message of a request."""
    i = ask.intrinsics
    header = {
        "protocol": PROTOCOL,
        "type": "ask",
        "seq": ask.seq,
        "t_s": ask.t_s,
        "position_ned_m": list(ask.camera_pose.position_ned_m),
        "q_wxyz": list(ask.camera_pose.q_wxyz),
        "camera": {
            "width_px": i.width_px,
            "height_px": i.height_px,
            "fx_px": i.fx_px,
            "fy_px": i.fy_px,
            "cx_px": i.cx_px,
            "cy_px": i.cy_px,
            "distortion": list(i.distortion),
        },
        "want": _wanted_parts(ask),
        "events": dict(ask.events),
        "moved": {
            name: {"position_ned_m": list(pose.position_ned_m), "q_wxyz": list(pose.q_wxyz)}
            for name, pose in ask.moved.items()
        },
    }
    return [pack_header(header)]


def simulated_image_of(parts: Sequence[Buffer], ask: ImageRequest) -> SimulatedImage:
    """Return the simulator's image in a reply, if it is the reply to this request.

    Raises LateAnswerError for one to an earlier request, RefusedError for the simulator's own
    refusal, BadMessageError where it breaks the protocol.
    """
    header = _header(parts)
    seq = header.whole("seq")
    if seq < ask.seq:
        raise LateAnswerError(f"it is the reply to request {seq}")
    if seq != ask.seq:
        raise BadMessageError(f"it is the reply to request {seq}, which was not sent yet")
    kind = header.text("type")
    if kind == "error":
        raise _refused(header)
    if kind != "picture":
        raise BadMessageError(f"`type` is {kind!r:.40}, not 'picture'")
    _check_echo(header, ask)
    found = _named_parts(header, parts[1:])
    size = (ask.intrinsics.width_px, ask.intrinsics.height_px)
    image, depth, ids = (
        found.get("image"),
        found.get("depth") if ask.want_depth else None,
        found.get("ids") if ask.want_ids else None,
    )
    if image is None or (ask.want_depth and depth is None) or (ask.want_ids and ids is None):
        raise BadMessageError(f"it has {sorted(found)}; requested were {_wanted_parts(ask)}")
    return SimulatedImage(
        decode_image_part(image[1], image[0], size),
        decode_depth_part(depth[1], depth[0], size) if depth is not None else None,
        decode_ids_part(ids[1], ids[0], size) if ids is not None else None,
    )


def _refused(header: MessageHeader) -> SimulatorRefusedError:
    """Return a simulator's refusal in its own words."""
    return SimulatorRefusedError(header.text("message")[:500])


def _header(parts: Sequence[Buffer]) -> MessageHeader:
    if not 1 <= len(parts) <= MAX_ANSWER_PARTS:
        raise BadMessageError(f"it has {len(parts)} parts")
    header = MessageHeader.unpack(parts[0])
    if header.text("protocol") != PROTOCOL:
        raise BadMessageError(
            f"it speaks {header.text('protocol')!r:.40}, we speak {PROTOCOL!r}; update the older "
            "side"
        )
    return header


def _named_parts(header: MessageHeader, parts: Sequence[Buffer]) -> dict[str, tuple[str, Buffer]]:
    """Return a protocol message's parts by name with their encodings. Raises BadMessageError."""
    listed = header.headers("parts")
    if len(listed) != len(parts):
        raise BadMessageError(f"`parts` lists {len(listed)} parts, {len(parts)} arrived")
    found = {
        each.text("name"): (each.text("encoding"), data)
        for each, data in zip(listed, parts, strict=True)
    }
    if len(found) != len(listed):
        raise BadMessageError("`parts` lists a name twice")
    return found


def _check_echo(header: MessageHeader, ask: ImageRequest) -> None:
    """Raise unless the simulator's image is of the requested pose and time."""
    position, q = header.numbers("position_ned_m", 3), header.numbers("q_wxyz", 4)
    pose = ask.camera_pose
    away_m = math.dist(position, pose.position_ned_m)
    opposite = tuple(-part for part in pose.q_wxyz)
    turned = min(math.dist(q, pose.q_wxyz), math.dist(q, opposite))
    if away_m > POSITION_TOLERANCE_M or turned > QUATERNION_TOLERANCE:
        raise BadMessageError(
            f"it is of another pose: {away_m:.4f} m away, quaternion {turned:.5f} apart"
        )
    late_s = header.number("t_s") - ask.t_s
    if abs(late_s) > TIME_TOLERANCE_S:
        raise BadMessageError(f"it is of another time: {late_s:+.4f} s")


def _wanted_parts(ask: ImageRequest) -> list[str]:
    return ["image", *["depth"] * ask.want_depth, *["ids"] * ask.want_ids]
