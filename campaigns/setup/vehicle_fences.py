"""Fences of vehicles, from a campaign's `geofence` or from a document that changes it in flight."""

from collections.abc import Mapping
from dataclasses import dataclass

from wil_campaign.campaigns.schema import VEHICLES, GeofencePart, VehicleName
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Path,
    Problem,
    check_document,
)
from wil_campaign.safety.fence.areas import FenceError
from wil_campaign.safety.fence.fence_files import is_fence_file, read_fence_file
from wil_campaign.safety.fence.fence_schema import FencePart
from wil_campaign.safety.fence.geofence import Fence, require_few_corners
from wil_campaign.safety.fence.geographic import DrawnFence
from wil_campaign.worlds.geodesy import LocalFrame


@dataclass(frozen=True, slots=True)
class FenceDrawing:
    """The sources of vehicle fences: the document, the fence files it names, the world's frame.

    frame: None where the world is missing: areas on Earth are then left out.
    """

    document: Document
    files: Mapping[str, Document]
    frame: LocalFrame | None


def fences_of_vehicles(part: GeofencePart, drawing: FenceDrawing, path: Path) -> dict[str, Fence]:
    """Return the fence of each vehicle that has one: its own, else that for both.

    path: of the part in the document. Raises BadInput with every problem.
    """
    problems: list[Problem] = []
    common = _fence(part, drawing, path, problems) if part.is_drawn else None
    own: dict[VehicleName, FencePart | None] = {"real": part.real, "twin": part.twin}
    fences: dict[str, Fence] = {}
    for name, one in own.items():
        fence = common if one is None else _fence(one, drawing, (*path, name), problems)
        if fence is not None:
            fences[name] = fence
    if problems:
        raise BadInput(problems)
    return fences


def changed_fences(
    document: Document, frame: LocalFrame, present: Mapping[str, Fence]
) -> dict[str, Fence]:
    """Return the new fences of vehicles in flight from a document.

    The document is like a campaign's `geofence`, without files; or it is a QGroundControl plan or
    GeoJSON, for every vehicle that has a fence at present, which keeps its floor and ceiling.
    Raises BadInput with every problem.
    """
    if is_fence_file(document):
        return _redrawn(document, frame, present)
    part = check_document(document, GeofencePart)
    problems = [
        document.problem((key,), f"'{key}' cannot be changed in flight", key=True)
        for key in ("keep_m", "latency_s", "braking_m_s2")
        if document.get((key,)) is not None
    ]
    for at in ((), *((name,) for name in VEHICLES)):
        path: Path = (*at, "file")
        if document.get(path) is not None:
            problems += [document.problem(path, "send the file itself, or its areas")]
    if problems:
        raise BadInput(problems)
    return fences_of_vehicles(part, FenceDrawing(document, {}, frame), ())


def _redrawn(
    document: Document, frame: LocalFrame, present: Mapping[str, Fence]
) -> dict[str, Fence]:
    """Return the vehicles' fences from a fence file; floors and ceilings stay as they are."""
    drawn = read_fence_file(document)
    try:
        inclusions, exclusions = drawn.local(frame)
        fences: dict[str, Fence] = {
            name: require_few_corners(
                Fence(
                    inclusions=inclusions,
                    exclusions=exclusions,
                    floor_up_m=present[name].floor_up_m,
                    ceiling_up_m=present[name].ceiling_up_m,
                )
            )
            for name in VEHICLES
            if name in present
        }
    except FenceError as error:
        raise BadInput([document.problem((), str(error))]) from error
    if not fences:
        message = "no vehicle has a fence whose floor and ceiling could be kept"
        raise BadInput([document.problem((), message)])
    return fences


def _fence(
    part: FencePart, drawing: FenceDrawing, path: Path, problems: list[Problem]
) -> Fence | None:
    drawn: DrawnFence | None = None
    try:
        if part.file is not None:
            if part.file not in drawing.files:
                return None  # `fence_files` reported the missing file
            drawn = read_fence_file(drawing.files[part.file])
        return require_few_corners(part.fence(drawing.frame, drawn))
    except BadInput as error:
        problems += error.problems
    except FenceError as error:
        if drawing.frame is None and error.reason == "far":
            return None  # the missing world is reported already
        place = path if part.file is None else (*path, "file")
        problems.append(drawing.document.problem(place, str(error), key=part.file is None))
    return None
