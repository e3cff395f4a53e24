"""Renders a world: `python -m wil_campaign.plugins.start.preview WORLD.yaml IMAGE.png`.

For authors of worlds: is the mesh upright, its unit right, the gate where it should be?
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import cv2
import numpy as np

from wil_campaign.foundation.files.documents import BadInput, load_document
from wil_campaign.worlds.camera import LEAST_FOV_DEG, Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer, RenderOutput
from wil_campaign.worlds.scene.motion import MOMENTS
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.world_file.world import Mode, Which, World

_LARGEST = 1e6
_STRAIGHT_DEG = 180.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Render a preview of a world file; 2 for a bad file, 3 for an output that fails."""
    options = _parser().parse_args(arguments)
    try:
        world = World.parse(load_document(options.world))
    except BadInput as error:
        sys.stderr.write("".join(f"{problem}\n" for problem in error.problems))
        return 2
    scene = world.scene(options.mode, options.which)
    image = _draw_image(scene, options)
    coded, data = cv2.imencode(options.image.suffix or ".png", image.image_bgr)
    try:
        options.image.write_bytes(data.tobytes() if coded else b"")
    except OSError as error:
        sys.stderr.write(f"{options.image}: {error.strerror}\n")
        return 3
    sys.stdout.write("".join(f"{line}\n" for line in _shown_objects(scene, image)))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m wil_campaign.plugins.start.preview", description=__doc__
    )
    parser.add_argument("world", type=Path, help="a world file")
    parser.add_argument("image", type=_image_file, help="the image to write (.png, .jpg)")
    for name, default, text in (
        ("north", 0.0, "camera position, metres"),
        ("east", 0.0, "camera position, metres"),
        ("up", 1.5, "camera position, metres"),
        ("yaw", 0.0, "camera yaw, degrees clockwise from north"),
        ("pitch", 0.0, "camera pitch, degrees upwards"),
        ("fov", 69.0, "horizontal field of view, degrees"),
        ("at", 0.0, "time of motions, seconds after t0"),
    ):
        kind = _fov if name == "fov" else _number
        parser.add_argument(f"--{name}", type=kind, default=default, help=f"{text} ({default:g})")
    parser.add_argument("--size", type=_size, default=(960, 540), help="WIDTHxHEIGHT (960x540)")
    parser.add_argument("--mode", choices=get_args(Mode), default="wil", help="of the run (wil)")
    parser.add_argument(
        "--which", choices=get_args(Which), default="Wv", help="real or virtual world (Wv)"
    )
    parser.add_argument(
        "--event",
        type=_event,
        action="append",
        default=[("goal", 0.0)],
        metavar="NAME=TIME",
        help=f"when an event happened that motions wait for: {', '.join(MOMENTS)} (goal=0)",
    )
    return parser


def _image_file(text: str) -> Path:
    """Return the preview's output path. Raises ArgumentTypeError for an unknown suffix."""
    if Path(text).suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise argparse.ArgumentTypeError("the image's name must end in .png or .jpg")
    return Path(text)


def _number(text: str) -> float:
    """Return a place, angle or time of the preview. Raises ArgumentTypeError if not finite."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not abs(number) <= _LARGEST:
        raise argparse.ArgumentTypeError(f"must be a number up to {_LARGEST:g}")
    return number


def _fov(text: str) -> float:
    """Return the preview's field of view, degrees. Raises ArgumentTypeError for no angle."""
    if not LEAST_FOV_DEG <= (angle := _number(text)) < _STRAIGHT_DEG:
        message = f"must be an angle from {LEAST_FOV_DEG:g} to below 180 degrees"
        raise argparse.ArgumentTypeError(message)
    return angle


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.partition("x")
    if not cross or not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError("must be WIDTHxHEIGHT, such as 960x540")
    size = (int(width), int(height))
    if not all(1 <= side <= 8192 for side in size):
        raise argparse.ArgumentTypeError("width and height are 1 to 8192")
    return size


def _event(text: str) -> tuple[str, float]:
    """Return name and time of an event given to the preview. Raises ArgumentTypeError."""
    name, equals, at_s = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError("must be NAME=SECONDS, such as goal=0")
    if name not in MOMENTS:
        raise argparse.ArgumentTypeError(f"motions wait for one of {', '.join(MOMENTS)}")
    return name, _number(at_s)


def _draw_image(scene: Scene, options: argparse.Namespace) -> RenderOutput:
    """Return the rendered preview of a scene from the given camera pose."""
    width_px, height_px = options.size
    camera = Intrinsics.from_fov(width_px, height_px, math.radians(options.fov))
    turn = {"pitch_rad": math.radians(options.pitch), "yaw_rad": math.radians(options.yaw)}
    pose = Pose.of(options.north, options.east, options.up, **turn)
    return Renderer(scene).render(pose, camera, options.at, dict(options.event))


def _shown_objects(scene: Scene, image: RenderOutput) -> list[str]:
    """Return a line per object of the preview: its share of the image, and its distance."""
    lines: list[str] = []
    depth_m, object_ids = image.depth_m, image.object_ids
    if depth_m is None or object_ids is None:
        return lines
    for scene_object in scene.objects:
        here = object_ids == scene_object.object_id
        size_m = np.ptp(scene_object.shape.mesh.vertices_m, axis=0)
        extent = " x ".join(f"{side:.3g}" for side in size_m.tolist())
        seen = "not visible"
        if here.any():
            seen = f"{here.mean():.1%} of the image, from {depth_m[here].min():.2f} m on"
        lines.append(f"{scene_object.name}: {seen}; {extent} m (its forward, right, down)")
    return lines


if __name__ == "__main__":
    sys.exit(main())
