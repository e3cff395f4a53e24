"""Checks of external I/O: sensor sources, and what observes runs; pure."""

from collections.abc import Iterator

from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.foundation.files.documents import Problem


def external_problems(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield the problems of one mode's external sources and observers."""
    yield from _sources_without_requests(files, case, mode)
    yield from _sources_without_link(files, case, mode)
    for observer in case.observers.values():
        yield from observer.problems(files, case, mode)


def _sources_without_requests(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield external sources of the twin that only stream, where `register` needs requests."""
    if mode != "wil" or case.recipe is None:
        return
    registered = {
        combination.sensor.name
        for combination in case.recipe.combinations
        if any(step.kind.name == "register" for step in combination.steps)
    }
    for sensor, source in case.vehicles["twin"].sourced:
        if sensor.name in registered:
            path = ("vehicles", "twin", "sensors", sensor.name, "source")
            message = (
                f"the recipe registers '{sensor.name}', but {source.address} cannot provide a "
                "reading from a requested pose: remove `source`, or remove `register`"
            )
            yield files.campaign.problem(path, message)
    for camera in case.vehicles["twin"].cameras:
        if (
            camera.name in registered
            and camera.source is not None
            and not camera.source.renders_on_request
        ):
            path = ("vehicles", "twin", "sensors", camera.name, "source")
            message = (
                f"the recipe registers '{camera.name}', but {camera.source.address} cannot "
                "provide an image from a requested pose: remove `source`, name a simulator "
                "(tcp://HOST:PORT), or remove `register`"
            )
            yield files.campaign.problem(path, message)


def _sources_without_link(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield MAVLink sources of a placed twin, which has no link."""
    if mode != "wil" or case.vehicles["twin"].coupling != "placed":
        return
    for sensor, source in case.vehicles["twin"].sourced:
        if source.kind == "mavlink":
            path = ("vehicles", "twin", "sensors", sensor.name, "source")
            message = "a placed twin does not fly and sends no MAVLink messages; remove `source`"
            yield files.campaign.problem(path, message)
