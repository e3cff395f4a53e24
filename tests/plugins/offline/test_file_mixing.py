"""`wil-campaign mix`: images, videos, worlds and recordings, what comes out, and bad input."""

import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from tests.recipes.samples import beam, camera, depth, plain
from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.recording.mcap.mcap_settings import LOSSLESS
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder
from wil_campaign.orchestrator.recording.video import VideoWriter
from wil_campaign.plugins.offline.contact_sheet import ContactSheet
from wil_campaign.plugins.python.mcap_reader import RecordedReading, Recording
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.pipeline.pipeline import compile_recipe
from wil_campaign.recipes.pipeline.stages import StageView
from wil_campaign.recipes.working import Masked

WIDTH, HEIGHT = 160, 120
ORANGE = (0, 110, 230)
COLOR = """\
schema: wil/recipe/1
sensors: {camera: {type: camera}, range: {type: rangefinder}}
combine:
  - sensor: camera
    transform: [register, {resize: {to: real}}]
    filter: [{isolate_color: orange}]
    merge: overlay
    max_skew_ms: 20
  - {sensor: range, merge: {aggregate: min}}
"""
OBJECTS = """\
schema: wil/recipe/1
sensors: {camera: {type: camera}}
combine:
  - {sensor: camera, filter: [{isolate_objects: [gate]}], merge: {overlay: {occlusion: by_depth}}}
"""
WORLD = """\
schema: wil/world/1
description: A gate
origin: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
objects:
  gate: {shape: {gate: {inner_size_m: 1.0}}, pose: {north_m: 3, up_m: 1.2}}
"""


def wall() -> Any:
    rng = np.random.default_rng(4)
    return rng.integers(90, 160, (HEIGHT, WIDTH, 3), dtype=np.uint8)


def render(left: int = 40) -> Any:
    image = plain((200, 200, 200), WIDTH, HEIGHT)
    image[30:60, left : left + 30] = ORANGE
    return image


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A folder with a photo, a render, a recipe, a world."""
    cv2.imwrite(str(tmp_path / "photo.png"), wall())
    cv2.imwrite(str(tmp_path / "render.png"), render())
    (tmp_path / "color.yaml").write_text(COLOR)
    (tmp_path / "objects.yaml").write_text(OBJECTS)
    (tmp_path / "world.yaml").write_text(WORLD)
    return tmp_path


def mix(folder: Path, recipe: str, real: str, twin: str, out: str, *more: str) -> int:
    files = ["--real", str(folder / real), "--twin", str(folder / twin)]
    return main(["mix", str(folder / recipe), *files, "--out", str(folder / out), *more])


def test_a_photo_and_a_render_become_a_mixed_picture(here: Path) -> None:
    sheet = str(here / "sheet.png")
    assert mix(here, "color.yaml", "photo.png", "render.png", "mixed.png", "--stages", sheet) == 0
    found = cv2.imread(str(here / "mixed.png"))
    assert found is not None
    wanted = wall()
    wanted[30:60, 40:70] = ORANGE
    assert np.array_equal(found, wanted)
    tiles = cv2.imread(sheet)
    assert tiles is not None
    # real, twin, resize; isolate_color, overlay, the edge
    assert tiles.shape[1] == 3 * 480
    assert 2 * 360 < tiles.shape[0] < 2 * 420


def test_a_smaller_render_is_resized_by_the_recipe(here: Path) -> None:
    cv2.imwrite(str(here / "small.png"), cv2.resize(render(), None, fx=0.5, fy=0.5))
    assert mix(here, "color.yaml", "photo.png", "small.png", "mixed.png") == 0
    found = cv2.imread(str(here / "mixed.png"))
    assert found is not None
    assert found[45, 55].tolist() == list(ORANGE)


def test_options_without_effect_are_refused(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = ("color.yaml", "photo.png", "small.png", "mixed.png")
    assert mix(here, *pictures, "--place", "0,0,1.2") == 2
    assert "--place: has no effect on this kind of input, image" in capsys.readouterr().err
    drawn = ("objects.yaml", "photo.png", "world.yaml", "mixed.png")
    assert mix(here, *drawn, "--twin-depth", str(here / "depth.npy")) == 2
    assert "--twin-depth: has no effect on this kind of input, world" in capsys.readouterr().err


def test_a_world_is_drawn_with_depth_and_names(here: Path) -> None:
    """Real things nearer than the gate hide it, farther ones do not."""
    depth = np.full((HEIGHT, WIDTH), 10.0, np.float32)
    depth[:, : WIDTH // 2] = 2.0
    np.save(here / "depth.npy", depth)
    place = ("--place", "0,0,1.2")
    near = ("--real-depth", str(here / "depth.npy"))
    assert mix(here, "objects.yaml", "photo.png", "world.yaml", "mixed.png", *place, *near) == 0
    found = cv2.imread(str(here / "mixed.png"))
    assert found is not None
    changed = (found != wall()).any(axis=2)
    assert not changed[:, : WIDTH // 2].any()
    assert 0.02 < changed[:, WIDTH // 2 :].mean() < 0.3
    # In millimetres, as depth cameras write it; nothing measured is far away.
    millimetres = np.where(depth < 5.0, 2000, 0).astype(np.uint16)
    cv2.imwrite(str(here / "depth.png"), millimetres)
    near = ("--real-depth", str(here / "depth.png"))
    assert mix(here, "objects.yaml", "photo.png", "world.yaml", "again.png", *place, *near) == 0
    assert (here / "again.png").read_bytes() == (here / "mixed.png").read_bytes()


def video(path: Path, count: int, hz: float, image: Callable[[int], Any], after: int = 0) -> None:
    with VideoWriter(path=path, rate_hz=hz) as writer:
        for k in range(after, count):
            writer.write(k / hz, image(k))


def frames_of(path: Path) -> list[tuple[float, Any]]:
    with av.open(str(path)) as container:
        return [(f.time, f.to_ndarray(format="bgr24")) for f in container.decode(video=0)]


def test_videos_of_two_rates_are_paired_by_time(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video(here / "real.mp4", 30, 30.0, lambda _: plain((120, 120, 120), WIDTH, HEIGHT))
    video(here / "twin.mp4", 60, 60.0, lambda k: render(20 + k))
    assert mix(here, "color.yaml", "real.mp4", "twin.mp4", "mixed.mp4", "--json") == 0
    (report,) = json.loads(capsys.readouterr().out)
    assert (report["frames"], report["mixed"], report["dropped"]) == (30, 30, {})
    frames = frames_of(here / "mixed.mp4")
    assert len(frames) == 30
    for k, (_, image) in enumerate(frames[:20]):
        assert abs(int(image[45, 20 + 2 * k + 15, 2]) - ORANGE[2]) < 30
        assert abs(int(image[45, 20 + 2 * k - 8, 2]) - 120) < 30


def test_images_too_far_apart_in_time_are_omitted_and_reported(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video(here / "real.mp4", 30, 30.0, lambda _: plain((120, 120, 120), WIDTH, HEIGHT))
    video(here / "twin.mp4", 10, 30.0, lambda _: render())
    assert mix(here, "color.yaml", "real.mp4", "twin.mp4", "mixed.mp4") == 3
    said = capsys.readouterr().err
    assert "camera: 10 of 30 mixed (stale 20)" in said
    assert "more than 20 ms" in said
    assert len(frames_of(here / "mixed.mp4")) == 30


def test_one_render_serves_a_whole_video(here: Path) -> None:
    video(here / "real.mp4", 5, 30.0, lambda _: plain((120, 120, 120), WIDTH, HEIGHT))
    assert mix(here, "color.yaml", "real.mp4", "render.png", "mixed.mp4") == 0
    assert len(frames_of(here / "mixed.mp4")) == 5


def recorded(path: Path) -> None:
    with McapRecorder(path=path, epoch_s=0.0, clock="virtual", settings=LOSSLESS) as run:
        for k in range(6):
            t_s = k / 10
            for side, image in (("real", wall()), ("twin", render(20 + k))):
                found = camera(image, side)  # type: ignore[arg-type]  # a literal in a tuple
                run.reading("camera", replace(found, t_s=t_s, arrived_s=t_s + 0.01, seq=k))
            run.reading("range", replace(beam(2.0, "real"), t_s=t_s, arrived_s=t_s, seq=k))
            run.reading("range", replace(beam(1.5), t_s=t_s, arrived_s=t_s, seq=k))


def test_recordings_are_mixed_sensor_by_sensor(here: Path) -> None:
    recorded(here / "run.mcap")
    assert mix(here, "color.yaml", "run.mcap", "run.mcap", "mixed.mcap") == 0
    found = Recording(here / "mixed.mcap")
    readings = [item for item in found if isinstance(item, RecordedReading)]
    assert [reading.sensor for reading in readings] == ["camera"] * 6 + ["range"] * 6
    first: Any = readings[0].reading
    assert first.image_bgr[45, 35].tolist() == list(ORANGE)
    assert all(reading.reading.range_m == 1.5 for reading in readings[6:])  # type: ignore[union-attr]
    # A folder stands for the run in it; a video shows the camera.
    assert mix(here, "color.yaml", ".", ".", "mixed.mp4") == 0
    assert len(frames_of(here / "mixed.mp4")) == 6


def test_a_cut_recording_is_mixed_as_far_as_it_goes_and_that_is_reported(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(here / "run.mcap")
    whole = (here / "run.mcap").read_bytes()
    (here / "run.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    assert mix(here, "color.yaml", ".", ".", "mixed.mcap", "--sensor", "range") == 3
    assert "run.mcap: the recording is cut after byte " in capsys.readouterr().err
    (here / "run.mcap").write_bytes(b"")
    assert mix(here, "color.yaml", ".", ".", "again.mcap") == 2
    assert "of twin; the recording is cut after byte 0" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--out", "--stages"])
@pytest.mark.parametrize("name", ["run.mcap", "mixed.mp4", "mixed.png"])
def test_files_of_a_run_are_never_written(
    here: Path, capsys: pytest.CaptureFixture[str], name: str, option: str
) -> None:
    (here / "run").mkdir()
    recorded(here / "run" / "run.mcap")
    for made in ("log.jsonl", "mixed.mp4", "mixed.png"):
        (here / "run" / made).write_text("as flown")
    before = (here / "run" / name).read_bytes()
    names = {"--out": str(here / "m.mcap"), option: str(here / "run" / name)}
    given = [word for pair in names.items() for word in pair]
    files = ("--real", str(here / "run"), "--twin", str(here / "run"))
    assert main(["mix", str(here / "color.yaml"), *files, *given]) == 2
    assert "write to another file" in capsys.readouterr().err
    assert (here / "run" / name).read_bytes() == before


BAD = [
    (("nothing.yaml", "photo.png", "render.png", "m.png"), 2, "cannot be read"),
    (("color.yaml", "nothing.png", "render.png", "m.png"), 2, "there is no such file"),
    (("color.yaml", "text.png", "render.png", "m.png"), 2, "cannot be read as an image"),
    (("color.yaml", "photo.png", "render.png", "m.gif"), 2, "name an image"),
    (("color.yaml", "broken.mp4", "render.png", "m.mp4"), 2, "broken.mp4"),
    (("color.yaml", "nothing.mp4", "render.png", "m.mp4"), 2, "nothing.mp4"),
    (("color.yaml", "world.yaml", "render.png", "m.png"), 2, "the real side needs an image"),
    (("color.yaml", "photo.png", "run.mcap", "m.png"), 2, "give recordings for both sides"),
    (("color.yaml", "text.mcap", "text.mcap", "m.mcap"), 2, "text.mcap"),
    (("objects.yaml", "photo.png", "render.png", "m.png"), 2, "give a world file"),
    (("elsewhere.yaml", "photo.png", "world.yaml", "m.png"), 2, "did you mean 'gate'?"),
    (("objects.yaml", "photo.png", "world.yaml", "m.png"), 3, "real has no depth"),
    (("plain.yaml", "photo.png", "half.png", "m.png"), 3, "add a resize step"),
    (("color.yaml", "photo.png", "render.png", "photo.png"), 2, "is an input"),
    (("mine.yaml", "photo.png", "render.png", "m.png"), 3, "mine.py:half, frame 0: ZeroDivision"),
    (("onnx.yaml", "photo.png", "render.png", "m.png"), 2, "none.onnx"),
]


@pytest.mark.parametrize(("files", "code", "said"), BAD, ids=[bad[2] for bad in BAD])
def test_bad_input_is_reported_and_nothing_is_written(
    here: Path,
    capsys: pytest.CaptureFixture[str],
    files: tuple[str, str, str, str],
    code: int,
    said: str,
) -> None:
    for name in ("text.png", "broken.mp4", "text.mcap", "none.onnx"):
        (here / name).write_text("this is none\n" * 50)
    cv2.imwrite(str(here / "half.png"), render()[::2, ::2])
    (here / "elsewhere.yaml").write_text(OBJECTS.replace("gate", "gates"))
    (here / "plain.yaml").write_text(COLOR.replace(", {resize: {to: real}}", ""))
    (here / "mine.py").write_text("def half(work, other):\n    return 1 / 0\n")
    (here / "mine.yaml").write_text(
        COLOR.replace("{isolate_color: orange}", "{use: 'mine.py:half'}")
    )
    (here / "onnx.yaml").write_text(
        COLOR.replace("isolate_color: orange", "isolate_detections: {model: none.onnx, names: [a]}")
    )
    recorded(here / "run.mcap")
    assert mix(here, *files) == code
    told = capsys.readouterr()
    assert said in told.err
    assert "Traceback" not in told.err
    assert told.out == ""
    if files[3] == "photo.png":
        assert np.array_equal(np.asarray(cv2.imread(str(here / "photo.png"))), wall())
    else:
        assert not (here / files[3]).exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--place", "1,2"), "--place 1,2: give NORTH,EAST,UP"),
        (("--place", "1,2,x"), "--place 1,2,x"),
        (("--real-fov-deg", "180"), "--real-fov-deg 180"),
        (("--real-fov-deg", "5e-324"), "--real-fov-deg 4.94066e-324"),
        (("--sensor", "sonar"), "no sensor 'sonar'"),
        (("--sensor", "range"), "'range', a rangefinder, from recordings into an .mcap alone"),
        (("--stages", "SHEET", "--frame", "1"), "there is no frame 1"),
        (("--stages", "OUT"), "is the mixture's file"),
        (("--stages", "steps.txt"), "name an image (.png)"),
        (("--real-depth", "DEPTH"), "depth of 3x2 for an image of 160x120"),
        (("--twin-depth", "PHOTO"), "is not a 16-bit image"),
    ],
)
def test_bad_options_are_reported(
    here: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], said: str
) -> None:
    np.save(here / "d.npy", np.ones((2, 3)))
    files = {"SHEET": "s.png", "DEPTH": "d.npy", "PHOTO": "photo.png", "OUT": "m.png"}
    given = [str(here / files[word]) if word in files else word for word in more]
    assert mix(here, "color.yaml", "photo.png", "render.png", "m.png", *given) == 2
    assert said in capsys.readouterr().err


def test_a_contact_sheet_shows_what_a_mask_leaves_out() -> None:
    sheet = ContactSheet()
    text = COLOR.partition("  - {sensor: range")[0]
    recipe = load_recipe(parse_document(text.encode(), name="r.yaml"))
    (mixer,) = compile_recipe(recipe, object_ids={}, observer=sheet)
    assert sheet.is_empty
    mixer.mix(camera(wall(), "real"), camera(render()), now_s=1.0)
    masked = sheet._tiles[3].image_bgr
    assert (masked[30:60, 40:70] == ORANGE).all()
    assert set(np.unique(masked[:20])) == {96, 128}
    assert [tile.label for tile in sheet._tiles] == [
        "real",
        "twin",
        "1. resize (twin)",
        "2. isolate_color (twin)",
        "merge: overlay",
        "edge, 6 times",
    ]


def test_a_contact_sheet_shows_depth_that_was_not_measured_as_far() -> None:
    depth_m = np.full((60, 80), 20.0, np.float32)
    depth_m[:30] = np.nan
    sheet = ContactSheet()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sheet(StageView("real", "real", Masked(depth(depth_m, "real"))))
    image = sheet._tiles[0].image_bgr
    assert (image == image[-1, -1]).all()
