"""The decoders of what users bring: documents, images, meshes, videos, recordings, results."""

import io
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import trimesh
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from tests.campaigns.conftest import CAMPAIGN, Files
from tests.faults.fuzzing.targets import Prepared, Target, by_file
from tests.orchestrator.report.recorded_campaign import write_campaign
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.foundation.files.documents import BadInput, load_document, parse_document
from wil_campaign.foundation.files.images import ImageError, decode_image_file
from wil_campaign.orchestrator.reading.results_folder import UnreadableError
from wil_campaign.orchestrator.reading.trajectory_file import read_trajectory
from wil_campaign.orchestrator.report.reading.event_log import read_event_log
from wil_campaign.orchestrator.report.reading.recorded_sights import read_sights
from wil_campaign.orchestrator.run_results.result_reader import ResultError, read_result
from wil_campaign.plugins.cameras.image_files import VideoFile
from wil_campaign.plugins.detector.detector import DetectorError, OnnxDetector
from wil_campaign.plugins.meshes.mesh_reader import load_mesh_shape
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.recorded_inputs import recording_items
from wil_campaign.plugins.paper_xml.paper_xml import parse_paper_xml
from wil_campaign.plugins.statistics.history.records import HistoryFileError, read_records
from wil_campaign.plugins.stl.formula import StlError
from wil_campaign.plugins.stl.parser import parse_stl
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.safety.evaluation.judge_log import JudgeLogError, read_judge_log
from wil_campaign.safety.fence.fence_files import read_fence_file
from wil_campaign.vehicles.embedded.profile import ProfileError, load_profile
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.worlds.scene.mesh_formats import MeshFileError
from wil_campaign.worlds.world_file.world import World

ROOT = Path(__file__).parents[3]
_FORMULAS = (
    b"always (speed_m_s <= 1.5)",
    b"eventually[0, 10] (up_m >= 1 and always[0:2] (abs(speed_m_s) <= 0.2))",
    b"(not (up_m > 2)) until[1,5] (clearance_m >= 0.3 -> up_m < 1e3)",
)
_PAPER_RECIPES = (
    b"""<recipe_file><AS_sensors><Camera id="c"/><Lidar id="l"/></AS_sensors><combine id="c">
<transform> camera.transform.py </transform><filter> color_isolation.py </filter>
<merge> prioritize_overlay.py </merge></combine><combine id="l"><merge by="min">aggregate.py</merge>
</combine></recipe_file>""",
    b"""<recipe_file description="two"><AS_sensors><Camera id="c" rate_hz="15"/><GPS id="g"
twin_type="pose"/></AS_sensors><combine id="c" publish="[real]" max_skew_ms="60"><transform
to="real">resize.py</transform><filter box="{left: 0.5}">isolate_region.py</filter><merge
occlusion="by_depth">overlay.py</merge></combine><combine id="g"><merge source="twin"
when="{of: real, what: fix_type, below: 3}">replace.py</merge></combine></recipe_file>""",
)
_FLIGHT = b"""{"campaign": "gate", "started_utc": "20261121T153936Z", "clock": "virtual",
"version": "1.0", "case": "large", "mode": "sim", "rep": "1", "seed": 7, "inputs": "ab",
"verdict": "PASS", "margin": 0.25, "duration_s": 23.5}""".replace(b"\n", b" ")
_PLAN = b"""{"fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": {},
"rallyPoints": {}, "geoFence": {"version": 2, "circles": [{"inclusion": false, "version": 1,
"circle": {"center": [47.3977, 8.5456], "radius": 4.5}}], "polygons": [{"inclusion": true,
"version": 1, "polygon": [[47.39, 8.54], [47.39, 8.55], [47.4, 8.55], [47.4, 8.54]]}]}}"""
_GEOJSON = b"""{"type": "FeatureCollection", "features": [{"type": "Feature", "properties":
{"inclusion": true}, "geometry": {"type": "Polygon", "coordinates": [[[8.54, 47.39],
[8.55, 47.39], [8.55, 47.4], [8.54, 47.39]]]}}, {"type": "Feature", "properties": {"radius_m": 5,
"inclusion": false}, "geometry": {"type": "Point", "coordinates": [8.545, 47.395]}}]}"""


def _files(*patterns: str) -> list[bytes]:
    return [path.read_bytes() for pattern in patterns for path in sorted(ROOT.glob(pattern))]


def _documents(folder: Path) -> Prepared:
    del folder
    seeds = [*_files("campaigns/*.yaml", "worlds/*.yaml", "recipes/*.yaml"), _PLAN, _GEOJSON]
    return Prepared(seeds, lambda data: parse_document(data, name="input"))


def _campaigns(folder: Path) -> Prepared:
    files = Files(folder)

    def load_changed(data: bytes) -> None:
        files.path.write_bytes(data)
        load_campaign(files.path)

    return Prepared([CAMPAIGN.encode()], load_changed)


def _worlds(folder: Path) -> Prepared:
    del folder

    def build(data: bytes) -> None:
        World.parse(parse_document(data, name="input")).scene("wil", "Wv")

    return Prepared(_files("worlds/*.yaml"), build)


def _recipes(folder: Path) -> Prepared:
    del folder
    return Prepared(
        _files("recipes/*.yaml"),
        lambda data: load_recipe(parse_document(data, name="input"), loads_code=False),
    )


def _paper_recipes(folder: Path) -> Prepared:
    del folder
    return Prepared(_PAPER_RECIPES, lambda data: parse_paper_xml(data, name="input"))


def _fences(folder: Path) -> Prepared:
    take = by_file(folder, ".plan", lambda path: read_fence_file(load_document(path, json=True)))
    return Prepared((_PLAN, _GEOJSON), take)


def _formulas(folder: Path) -> Prepared:
    del folder
    return Prepared(_FORMULAS, lambda data: parse_stl(data.decode("utf-8", "replace")))


def _profiles(folder: Path) -> Prepared:
    seeds = _files("vehicles/embedded/profiles/*.yaml")
    return Prepared(seeds, by_file(folder, ".yaml", load_profile))


def _picture() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return np.random.default_rng(1).integers(0, 256, (12, 16, 3), np.uint8)


def _images(folder: Path) -> Prepared:
    del folder
    kinds = (".png", ".jpg", ".bmp", ".tiff", ".webp", ".ppm")
    seeds = [cv2.imencode(kind, _picture())[1].tobytes() for kind in kinds]
    return Prepared(seeds, decode_image_file)


def _mesh(suffix: str) -> Callable[[Path], Prepared]:
    def prepared(folder: Path) -> Prepared:
        box = trimesh.creation.box((0.4, 0.2, 0.1))
        given = box.export(file_type=suffix.removeprefix("."))
        seed = given.encode() if isinstance(given, str) else bytes(given)
        return Prepared([seed], by_file(folder, suffix, load_mesh_shape))

    return prepared


def _gltf(folder: Path) -> Prepared:
    parts = trimesh.creation.box((0.4, 0.2, 0.1)).export(file_type="gltf")
    for name, content in parts.items():
        (folder / name).write_bytes(content)
    return Prepared([bytes(parts["model.gltf"])], by_file(folder, ".gltf", load_mesh_shape))


def _videos(folder: Path) -> Prepared:
    film = folder / "film.mp4"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (64, 48))
    for k in range(4):
        writer.write(np.full((48, 64, 3), 40 * k, np.uint8))
    writer.release()

    def play(path: Path) -> None:
        with closing(VideoFile(path=path)) as video:
            video.open()
            for _ in range(50):
                if video.next() is None:
                    break

    return Prepared([film.read_bytes()], by_file(folder, ".mp4", play))


def _recorded(folder: Path) -> Path:
    """Return a small run's folder, as the report reads one."""
    made = write_campaign(folder / "campaign")
    return min(made.glob("*/*/*/run.mcap")).parent


def _uncompressed(path: Path) -> bytes:
    """Return a recording without compression and checksums: what is changed is then decoded."""
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.NONE, enable_crcs=False)
    writer.start()
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream)
        for facts in reader.iter_metadata():
            writer.add_metadata(facts.name, facts.metadata)
        for schema, channel, message in reader.iter_messages():
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic,
                    channel.message_encoding,
                    schemas[channel.schema_id],
                    channel.metadata,
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def _recordings(folder: Path) -> Prepared:
    recording = _recorded(folder) / "run.mcap"
    seeds = [recording.read_bytes(), *[_uncompressed(recording)] * 3]

    def read(path: Path) -> None:
        read_sights(path, mode="wil", wanted_s=(0.5, 1.0))
        for _ in recording_items(path):
            pass

    return Prepared(seeds, by_file(folder, ".mcap", read))


def _results(folder: Path) -> Prepared:
    run = _recorded(folder)
    return Prepared([(run / "result.json").read_bytes()], by_file(folder, ".json", read_result))


def _logs(folder: Path) -> Prepared:
    run = _recorded(folder)
    seeds = [path.read_bytes() for path in (run / "log.jsonl", run / "trajectory.csv")]

    def read(path: Path) -> None:
        read_event_log(path)
        read_trajectory(path)

    return Prepared(seeds, by_file(folder, ".log", read))


def _judge_logs(folder: Path) -> Prepared:
    seed = (_recorded(folder) / "judged.msgpack").read_bytes()[:20_000]

    def read(data: bytes) -> None:
        for _ in read_judge_log(io.BytesIO(data)):
            pass

    return Prepared([seed], read)


def _histories(folder: Path) -> Prepared:
    return Prepared([_FLIGHT], by_file(folder, ".jsonl", read_records))


def _networks(folder: Path) -> Prepared:
    seeds = _files("plugins/detector/models/*.onnx")
    image = np.zeros((240, 320, 3), np.uint8)

    def detect(path: Path) -> None:
        OnnxDetector(path, names=("a", "b"), input_px=(320, 240)).detect(image)

    return Prepared(seeds, by_file(folder, ".onnx", detect))


FILE_TARGETS: Sequence[Target] = (
    Target("yaml and json", (BadInput,), _documents),
    Target("campaign", (BadInput,), _campaigns),
    Target("world", (BadInput,), _worlds),
    Target("recipe", (BadInput,), _recipes),
    Target("xml recipe", (BadInput,), _paper_recipes),
    Target("fence file", (BadInput,), _fences),
    Target("formula", (StlError,), _formulas),
    Target("profile", (ProfileError, BadInput), _profiles),
    Target("image", (ImageError,), _images),
    *(
        Target(f"mesh {suffix}", (MeshFileError,), _mesh(suffix))
        for suffix in (".obj", ".stl", ".ply", ".glb", ".dae")
    ),
    Target("mesh .gltf", (MeshFileError,), _gltf),
    Target("video", (SourceError,), _videos),
    Target("recording", (OfflineError,), _recordings),
    Target("result", (ResultError,), _results),
    Target("log and trajectory", (UnreadableError,), _logs),
    Target("judge log", (JudgeLogError,), _judge_logs),
    Target("history", (HistoryFileError,), _histories),
    Target("network", (DetectorError,), _networks),
)
