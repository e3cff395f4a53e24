"""The reference simulator: an example of a bridge for Unity, Unreal, Gazebo or your own engine.

    python -m wil_campaign.plugins.simulator.reference_simulator --world worlds/gate.yaml \
        --bind tcp://127.0.0.1:5555

It needs a REP socket of ZeroMQ and MessagePack, and of this program only the renderer, which is
the part that you replace. docs/simulator-protocol.md says what each key means.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np
import zmq

from wil_campaign.foundation.files.documents import BadInput, load_document
from wil_campaign.plugins.simulator.shown_world import packed_objects, shown_objects
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.world_file.world import World

PROTOCOL = "wil/pictures/1"


def welcome_reply(scene: Scene, world: str) -> list[bytes]:
    """Return the reference simulator's reply to `hello`: its name, known objects and their shapes.

    `hello` says which case of the world is flown. This simulator shows one world file as it is, and
    reports the sizes of what it draws; yours may load the requested case.
    """
    answer = {
        "protocol": PROTOCOL,
        "type": "welcome",
        "simulator": "wil reference simulator",
        "objects": list(scene.names),
        "world": world,
        "shapes": packed_objects(shown_objects(scene)),
    }
    return [msgpack.packb(answer)]


def image_reply(renderer: Renderer, ask: dict[str, Any]) -> list[bytes]:
    """Return the reference simulator's reply to `ask`: the image, its pose and time."""
    # Your engine has another frame: north-east-down metres, and a camera that looks along its x
    # axis with y to the right and z down, have to become yours. See the table in the docs.
    camera_pose = Pose(tuple(ask["position_ned_m"]), tuple(ask["q_wxyz"]))
    camera = ask["camera"]
    intrinsics = Intrinsics(**{**camera, "distortion": tuple(camera["distortion"])})
    drawn = renderer.render(
        camera_pose,
        intrinsics,
        ask["t_s"],  # move your moving things to where they are at this time
        ask["events"],
        want_depth="depth" in ask["want"],
        want_ids="ids" in ask["want"],
    )
    listed, parts = [{"name": "image", "encoding": "bgr8"}], [drawn.image_bgr.tobytes()]
    if drawn.depth_m is not None:
        listed.append({"name": "depth", "encoding": "f32"})
        parts.append(drawn.depth_m.astype(np.dtype("<f4")).tobytes())
    if drawn.object_ids is not None:
        listed.append({"name": "ids", "encoding": "u8"})
        parts.append(drawn.object_ids.tobytes())
    header = {
        "protocol": PROTOCOL,
        "type": "picture",
        # These four are checked: the image must be of the requested pose and time.
        "seq": ask["seq"],
        "t_s": ask["t_s"],
        "position_ned_m": ask["position_ned_m"],
        "q_wxyz": ask["q_wxyz"],
        "parts": listed,
    }
    return [msgpack.packb(header), *parts]


def refusal_reply(seq: int, message: str) -> list[bytes]:
    """Return the reference simulator's refusal with the reason, for the run's log."""
    answer = {"protocol": PROTOCOL, "type": "error", "seq": seq, "message": message}
    return [msgpack.packb(answer)]


def simulator_reply(renderer: Renderer, scene: Scene, world: str, question: bytes) -> list[bytes]:
    """Return the reference simulator's reply to any message, since REP sockets must reply."""
    seq = 0
    try:
        ask = msgpack.unpackb(question)
        if ask["protocol"] != PROTOCOL:
            return refusal_reply(seq, f"this simulator speaks {PROTOCOL}")
        if ask["type"] == "hello":
            return welcome_reply(scene, world)
        seq = ask["seq"]
        return image_reply(renderer, ask)
    except (ValueError, TypeError, KeyError) as error:
        return refusal_reply(seq, f"the request cannot be read: {type(error).__name__}: {error}")


def main(arguments: list[str] | None = None) -> int:
    """Run the reference simulator until killed. Returns 2 for an unusable world."""
    parser = argparse.ArgumentParser(description="Reference simulator of the picture protocol")
    parser.add_argument("--world", type=Path, required=True, help="world file (YAML)")
    parser.add_argument("--bind", default="tcp://127.0.0.1:5555", help="tcp://HOST:PORT")
    parser.add_argument("--mode", choices=["sim", "wil", "real"], default="wil")
    chosen = parser.parse_args(arguments)
    try:
        scene = World.parse(load_document(chosen.world)).scene(chosen.mode, "Wv")
    except BadInput as error:
        sys.stderr.write(f"{error}\n")
        return 2
    renderer, world = Renderer(scene), chosen.world.stem
    # The first image takes long, as with every engine: draw one before the first request.
    renderer.render(Pose((0.0, 0.0, 0.0)), Intrinsics.from_fov(16, 12, 1.0), 0.0)
    with zmq.Context() as context, context.socket(zmq.REP) as socket:
        socket.bind(chosen.bind)
        # With port * the operating system chooses one: the starting program reads which.
        sys.stdout.write(f"{socket.getsockopt_string(zmq.LAST_ENDPOINT)}\n")
        sys.stdout.flush()
        while True:
            parts = socket.recv_multipart()
            socket.send_multipart(simulator_reply(renderer, scene, world, parts[0]))


if __name__ == "__main__":
    sys.exit(main())
