"""What a campaign required at its flight, from its manifest; pure."""

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from wil_campaign.campaigns.schema.campaign import UntilDecidedPart
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.campaigns.values.acceptance import Requirement, Share, parse_share


class RequirementsError(Exception):
    """The requirements of a manifest are damaged; the message says where."""


@cache
def _model() -> TypeAdapter[tuple[Requirement, ...]]:
    return TypeAdapter(tuple[Requirement, ...])


def flown_requirements(manifest: Mapping[str, Any]) -> tuple[Requirement, ...]:
    """Return what a campaign required of its cases and modes. Raises RequirementsError.

    For a folder of an earlier version, which does not record it, that is what its campaign file
    says; what is missing there must pass always.
    """
    if "requirements" not in manifest:
        return tuple(_requirements_of_document(manifest))
    try:
        return _model().validate_python(manifest["requirements"])
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, ("requirements", *first["loc"])))
        raise RequirementsError(f"{where}: {first['msg']}") from error


def _requirements_of_document(manifest: Mapping[str, Any]) -> Iterator[Requirement]:
    """Yield what the document of a manifest says; none of it where it is damaged."""
    document = manifest.get("document")
    if not isinstance(document, dict):
        return
    repetitions = document.get("repetitions", 1)
    if isinstance(repetitions, dict):
        test = _test(repetitions)
        if test is None:
            return
        for case, mode in _places(manifest):
            yield Requirement(case, mode, Share(test.most, test.most), test)
    elif isinstance(repetitions, int) and isinstance(document.get("accept"), dict):
        for case, shares in document["accept"].items():
            for mode, text in shares.items() if isinstance(shares, dict) else ():
                if (share := _share(text)) is not None:
                    yield Requirement(case, mode, share.scaled(repetitions))


def _test(repetitions: Mapping[str, Any]) -> SequentialTest | None:
    try:
        return UntilDecidedPart.model_validate(repetitions).test
    except ValueError:
        return None


def _share(text: object) -> Share | None:
    try:
        return parse_share(text) if isinstance(text, str) else None
    except ValueError:
        return None


def _places(manifest: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the cases and modes of a manifest's runs, each once."""
    runs = manifest.get("runs")
    found = dict[tuple[str, str], None]()
    for run in runs if isinstance(runs, list) else ():
        name = run.get("run") if isinstance(run, dict) else None
        if isinstance(name, str) and name.count("/") == 2:
            case, mode, _ = name.split("/")
            found[case, mode] = None
    yield from found
