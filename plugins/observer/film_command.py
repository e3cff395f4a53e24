"""`wil-campaign film`: a recorded run as a fixed camera would see it from outside."""

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from cyclopts.validators import Number
from PIL import Image

from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.plugins.observer.observed_run import (
    ObservedRun,
    ObserverCamera,
    read_observed_run,
)
from wil_campaign.plugins.observer.observer_topic import write_observer_topic
from wil_campaign.vehicles.readings import BgrImage

_MOST_IMAGES = 20_000
_GIF_COLOURS = 96
_OF_THE_FLIGHT = ("run.mcap", "mixed.mp4", "mixed.png")
Frames = Iterator[tuple[float, BgrImage]]


def film(
    run: Path,
    *,
    out_: Annotated[Path, Parameter(name="--out")] = Path("observer.mp4"),
    rate_hz: Annotated[float | None, Parameter(validator=Number(gt=0.0, lte=60.0))] = None,
    unmarked: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Draw a recorded run as a fixed camera would see it from outside: vehicles, world, actors.

    The camera is the campaign's `observer`; without that key one that looks at the whole flight.
    Exit code 2: the folder has no recorded run, or the file's name has another ending; 3: the
    file cannot be written.

    Parameters
    ----------
    run
        The folder of a run: DIR/<campaign>/<UTC start>/<case>/<mode>/<repetition>.
    out_
        The file to write: .mp4 or .gif, from the takeoff to the end; .mcap, a topic
        /observer/camera of JPEG images, which Foxglove shows beside run.mcap; .png, the image in
        which the goal has been given for half of its time. A name without a folder is in that of
        the run.
    rate_hz
        Images in a second; by default those of the observer.
    unmarked
        Draw no ring and no name at the vehicles.
    """
    write = _WRITERS.get(out_.suffix.lower())
    if write is None:
        write_stderr(printable_problem(f"--out {out_}: the name must end in {', '.join(_WRITERS)}"))
        return 2
    try:
        seen = read_observed_run(run)
    except ResultsFolderError as error:
        write_stderr(printable_problem(str(error)))
        return 2
    observer = seen.observer or seen.default_observer
    if rate_hz is not None:
        observer = replace(observer, rate_hz=rate_hz)
    path = run / out_ if out_.parent == Path() else out_
    if path.name in _OF_THE_FLIGHT and path.exists():
        write_stderr(printable_problem(f"--out {out_}: is of the flight itself; name another file"))
        return 2
    camera = ObserverCamera(seen, observer)
    times = _times(seen, observer.rate_hz)
    if path.suffix.lower() == ".png":
        times = iter([_middle_s(seen)])
    frames = ((t_s, camera.draw(t_s, marked=not unmarked)) for t_s in times)
    part = path.with_name(f".{path.name}.part")
    try:
        part.unlink(missing_ok=True)
        write(part, frames, observer.rate_hz, seen.facts)
        part.replace(path)
    except OSError as error:
        write_stderr(printable_problem(f"{path} cannot be written: {error.strerror or error}"))
        return 3
    finally:
        part.unlink(missing_ok=True)
    write_stdout(printable_problem(f"film: {path}"))
    return 0


def _times(seen: ObservedRun, rate_hz: float) -> Iterator[float]:
    """Yield the times of the images: from the takeoff to the last pose."""
    begin_s = seen.stages.get("takeoff", seen.span_s[0])
    count = int((seen.span_s[1] - begin_s) * rate_hz) + 1
    yield from (begin_s + number / rate_hz for number in range(min(count, _MOST_IMAGES)))


def _middle_s(seen: ObservedRun) -> float:
    begin_s = seen.stages.get("goal", seen.span_s[0])
    ends = [seen.stages[one] for one in ("done", "land") if one in seen.stages]
    end_s = ends[0] if ends else seen.span_s[1]
    return (begin_s + end_s) / 2.0


def _write_video(path: Path, frames: Frames, rate_hz: float, facts: Mapping[str, str]) -> None:
    # PyAV takes a tenth of a second to import.
    from wil_campaign.orchestrator.recording.video import VideoWriter  # noqa: PLC0415

    del facts
    with VideoWriter(path=path, rate_hz=rate_hz) as video:
        first_s: float | None = None
        for t_s, image in frames:
            first_s = t_s if first_s is None else first_s
            video.write(t_s - first_s, image)


def _write_gif(path: Path, frames: Frames, rate_hz: float, facts: Mapping[str, str]) -> None:
    del facts
    images = [Image.fromarray(np.ascontiguousarray(image[:, :, ::-1])) for _, image in frames]
    palette = images[len(images) // 2].quantize(_GIF_COLOURS, dither=Image.Dither.NONE)
    reduced = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in images]
    reduced[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=reduced[1:],
        duration=round(1000.0 / rate_hz),
        loop=0,
        optimize=True,
    )


def _write_png(path: Path, frames: Frames, rate_hz: float, facts: Mapping[str, str]) -> None:
    del rate_hz, facts
    for _, image in itertools.islice(frames, 1):
        Image.fromarray(np.ascontiguousarray(image[:, :, ::-1])).save(path, format="PNG")


def _write_mcap(path: Path, frames: Frames, rate_hz: float, facts: Mapping[str, str]) -> None:
    del rate_hz
    write_observer_topic(path, frames, facts)


_Writer = Callable[[Path, Frames, float, Mapping[str, str]], None]
_WRITERS: Mapping[str, _Writer] = {
    ".mp4": _write_video,
    ".gif": _write_gif,
    ".mcap": _write_mcap,
    ".png": _write_png,
}
