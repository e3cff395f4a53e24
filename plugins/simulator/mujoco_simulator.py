"""MuJoCo renders the twin's world by docs/simulator-protocol.md: an example for other engines.

    pip install mujoco
    MUJOCO_GL=egl python -m wil_campaign.plugins.simulator.mujoco_simulator --bind tcp://127.0.0.1:5555

Draws the objects that `hello` lists: square gates, rooms and boxes, at rest or moving. It imports
nothing of this program. MuJoCo is no dependency of this program: only this file imports it.
"""

import argparse
from collections.abc import Iterator, Mapping
from typing import Any

import msgpack  # type: ignore[import-untyped]  # ships no types
import mujoco
import numpy as np
import zmq

PROTOCOL = "wil/pictures/1"
NWU = np.array((1.0, -1.0, -1.0))
"""North, east, down times this is x north, y west, z up; so is forward, right, down of a body."""
GREY = (150, 150, 155)
NEAR_M, FAR_M, WALL_M = 0.05, 100.0, 0.05

Shapes = Mapping[str, Mapping[str, Any]]


def mujoco_quaternion(q_wxyz: list[float]) -> tuple[float, float, float, float]:
    """Return a quaternion in MuJoCo's axes."""
    w, x, y, z = q_wxyz
    return w, x, -y, -z


def boxes_of_shape(shape: Mapping[str, Any]) -> Iterator[tuple[Any, Any]]:
    """Yield half size and middle of each box of a shape, along its forward, left and up axes."""
    depth, width, height = (size / 2 for size in shape["size_m"])
    if shape.get("form") == "square":
        inner = shape["opening_m"] / 2
        bar = (width - inner) / 2
        for side in (-1, 1):
            yield (depth, bar, height), (0, side * (inner + bar), 0)
            yield (depth, inner, bar), (0, 0, side * (inner + bar))
    elif shape["kind"] == "room":  # Its place is the middle of its floor.
        for side in (-1, 1):
            yield (WALL_M, width, height), (side * (depth + WALL_M), 0, height)
            yield (depth, WALL_M, height), (0, side * (width + WALL_M), height)
            yield (depth, width, WALL_M), (0, 0, height + side * (height + WALL_M))
    elif shape["kind"] == "box":
        yield (depth, width, height), (0, 0, 0)
    else:
        raise ValueError(f"this simulator draws no {shape.get('form', '')} {shape['kind']}")


def mujoco_model_of(shapes: Shapes) -> Any:
    """Compile MuJoCo's model of the objects, each a body of that name."""
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = (0.6,) * 3, (0,) * 3
    sun = {"type": mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, "dir": (1, -0.5, -2)}
    spec.worldbody.add_light(castshadow=False, diffuse=(0.5,) * 3, specular=(0,) * 3, **sun)
    for name, shape in shapes.items():
        place, turn = np.array(shape["position_ned_m"]) * NWU, mujoco_quaternion(shape["q_wxyz"])
        body = spec.worldbody.add_body(name=name, pos=place, quat=turn, mocap=True)
        rgba = (*(part / 255 for part in shape.get("color_rgb", GREY)), 1)
        for half, middle in boxes_of_shape(shape):
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=middle, rgba=rgba)
    return spec.compile()


def measured_shapes(model: Any, shapes: Shapes) -> dict[str, dict[str, Any]]:
    """Measure the bodies of the compiled model: what is drawn, not what was requested."""
    measured = {}
    for name, shape in shapes.items():
        body = model.body(name)
        geoms = slice(body.geomadr[0], body.geomadr[0] + body.geomnum[0])
        middle, half = model.geom_pos[geoms], model.geom_size[geoms]
        low, high = (middle - half).min(axis=0), (middle + half).max(axis=0)
        inner = 2 * (np.abs(middle - (low + high) / 2) - half).max(axis=0)
        measured[name] = {
            "kind": shape["kind"],
            "size_m": (inner if shape["kind"] == "room" else high - low).tolist(),
            "position_ned_m": (body.pos * NWU).tolist(),
            "q_wxyz": mujoco_quaternion(body.quat.tolist()),
            **({"opening_m": float(inner[1]), "form": "square"} if "form" in shape else {}),
        }
    return measured


def place_camera(scene: Any, ask: Mapping[str, Any]) -> None:
    """Place MuJoCo's cameras (one for each eye) at the requested pose, with its pinhole."""
    turn, camera = np.zeros(9), ask["camera"]
    mujoco.mju_quat2Mat(turn, np.array(ask["q_wxyz"], float))
    forward, _, down = turn.reshape(3, 3).T * NWU
    # Pixel (0, 0) is the middle of the first pixel: the image begins half a pixel before it.
    left, top = (-0.5 - camera["cx_px"]), (camera["cy_px"] + 0.5)
    right, bottom = left + camera["width_px"], top - camera["height_px"]
    for eye in scene.camera:
        eye.pos, eye.forward, eye.up = np.array(ask["position_ned_m"]) * NWU, forward, -down
        across, high = eye.frustum_near / camera["fx_px"], eye.frustum_near / camera["fy_px"]
        eye.frustum_center, eye.frustum_width = (
            across * (left + right) / 2,
            across * (right - left) / 2,
        )
        eye.frustum_top, eye.frustum_bottom = high * top, high * bottom


class DrawnScene:
    """The scene that one `hello` requested, as MuJoCo draws it."""

    def __init__(self, hello: Mapping[str, Any]) -> None:
        self.model = mujoco_model_of(hello["shapes"])
        self.shapes = measured_shapes(self.model, hello["shapes"])
        self._data = mujoco.MjData(self.model)
        self._ids = np.zeros(self.model.ngeom + 1, np.uint8)  # The last, -1, is the background.
        for geom, body in enumerate(self.model.geom_bodyid):
            self._ids[geom] = hello["objects"][self.model.body(body).name]
        self.model.vis.map.znear = NEAR_M / self.model.stat.extent
        self.model.vis.map.zfar = FAR_M / self.model.stat.extent
        self._renderers: dict[tuple[int, int], Any] = {}

    def draw(self, ask: Mapping[str, Any]) -> Iterator[tuple[str, str, bytes]]:
        """Yield name, encoding and bytes of each wanted part."""
        for name, moved in ask["moved"].items():
            mocap = self.model.body(name).mocapid[0]
            self._data.mocap_pos[mocap] = np.array(moved["position_ned_m"]) * NWU
            self._data.mocap_quat[mocap] = mujoco_quaternion(moved["q_wxyz"])
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_camlight(self.model, self._data)
        renderer = self._renderer((ask["camera"]["height_px"], ask["camera"]["width_px"]))
        renderer.update_scene(self._data)
        place_camera(renderer.scene, ask)
        yield "image", "rgb8", renderer.render().tobytes()
        if "depth" in ask["want"]:
            renderer.enable_depth_rendering()
            depth_m = renderer.render()
            depth_m[depth_m > 0.99 * FAR_M] = np.inf
            yield "depth", "f32", depth_m.astype("<f4").tobytes()
            renderer.disable_depth_rendering()
        if "ids" in ask["want"]:
            renderer.enable_segmentation_rendering()
            yield "ids", "u8", self._ids[renderer.render()[..., 0]].tobytes()
            renderer.disable_segmentation_rendering()

    def close(self) -> None:
        """Release the contexts of OpenGL."""
        for renderer in self._renderers.values():
            renderer.close()

    def _renderer(self, size: tuple[int, int]) -> Any:
        if size not in self._renderers:
            self.model.vis.global_.offheight, self.model.vis.global_.offwidth = size
            self._renderers[size] = mujoco.Renderer(self.model, *size)
        return self._renderers[size]


class MujocoSimulator:
    """Replies to requests; shows one scene at a time, that of the last hello."""

    def __init__(self) -> None:
        self._scene: DrawnScene | None = None

    def reply(self, parts: list[bytes]) -> list[bytes]:
        """Return the reply to any request: `error` to one that cannot be answered."""
        seq = 0
        try:
            request = msgpack.unpackb(parts[0])
            seq = request.get("seq", 0)
            return self._welcome(request) if request["type"] == "hello" else self._image(request)
        except Exception as error:  # noqa: BLE001 - a REP socket has to reply to every request
            return [_packed(type="error", seq=seq, message=f"{type(error).__name__}: {error}")]

    def _welcome(self, hello: Mapping[str, Any]) -> list[bytes]:
        if hello["protocol"] != PROTOCOL:
            raise ValueError(f"this simulator speaks {PROTOCOL}")
        if self._scene is not None:
            self._scene.close()
        self._scene = DrawnScene(hello)
        return [
            _packed(
                type="welcome",
                shapes=self._scene.shapes,
                simulator=f"MuJoCo {mujoco.__version__}",
                objects=list(hello["objects"]),
            )
        ]

    def _image(self, ask: Mapping[str, Any]) -> list[bytes]:
        if self._scene is None:
            raise ValueError("no scene is loaded: send a hello first")
        drawn = list(self._scene.draw(ask))
        echo = {key: ask[key] for key in ("seq", "t_s", "position_ned_m", "q_wxyz")}
        listed = [{"name": name, "encoding": encoding} for name, encoding, _ in drawn]
        return [_packed(type="picture", parts=listed, **echo), *(data for *_, data in drawn)]


def _packed(**header: Any) -> bytes:
    return bytes(msgpack.packb({"protocol": PROTOCOL, **header}))


def main() -> None:
    """Serve until killed."""
    parser = argparse.ArgumentParser(description="MuJoCo behind the picture protocol")
    parser.add_argument("--bind", default="tcp://127.0.0.1:5555", help="tcp://HOST:PORT")
    chosen, simulator = parser.parse_args(), MujocoSimulator()
    with zmq.Context() as context, context.socket(zmq.REP) as socket:
        socket.bind(chosen.bind)
        while True:
            socket.send_multipart(simulator.reply(socket.recv_multipart()))


if __name__ == "__main__":
    main()
