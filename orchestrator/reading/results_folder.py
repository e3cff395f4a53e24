"""The documents of a results folder: campaign.json, summary.json, and result.json of each run."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from wil_campaign.campaigns.schema.campaign import UntilDecidedPart
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare, parse_pass_share
from wil_campaign.foundation.files.limited_json import (
    JsonLimitError,
    check_json_values,
    read_limited_bytes,
)
from wil_campaign.orchestrator.campaign.resuming.cluster_ledger import open_orders
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.model import CampaignDocuments, RunEntry
from wil_campaign.orchestrator.run_results.campaign_results import Summary, is_same_result
from wil_campaign.orchestrator.run_results.exit_codes import is_campaign_accepted
from wil_campaign.orchestrator.run_results.result_reader import result_model, summary_model
from wil_campaign.orchestrator.run_results.run_result import RunResult

T = TypeVar("T")

MODES = ("sim", "wil", "real")
_LONGEST_NAME = 255
"""Bytes of a folder name that file systems allow."""
_OF_THE_MANIFEST = {"campaign": str, "started_utc": str, "runs": list, "document": dict}
"""Keys that campaign.json must have, each with its type."""
_SHOWN = 60
_BEGUN = (
    "the run was started and has no result: it is still flying, or its program died; `run "
    "--resume` resolves it"
)
_OF_A_SEARCH = "flights/*/campaign.json"
_OF_A_RUN = ("result.json", "log.jsonl", "run.mcap", "trajectory.csv", "judged.msgpack")


class UnreadableError(Exception):
    """A document cannot be used; the message says which and why."""


def read_campaign_documents(folder: Path) -> CampaignDocuments:
    """Return the documents of a results folder. Raises ResultsFolderError."""
    _require_campaign(folder)
    problems: list[str] = []
    found = _read_document(folder / "campaign.json", _mapping, problems)
    manifest = {} if found is None else found
    if found is not None:
        problems += _manifest_problems(found)
    requirements = _read_requirements(manifest, problems)
    summary = _read_document(
        folder / "summary.json", lambda text: _validate(summary_model(), text), problems
    )
    names = _run_names(manifest, summary)
    others = [name for name in _run_names_on_disk(folder) if name not in names]
    if not names:
        names = dict.fromkeys(filter(_is_run_name, others))  # of damaged documents
    elif others:
        problems.append(
            f"not counted: {', '.join(others)}; a decision was made without them, or they are "
            "of another campaign"
        )
    entries = tuple(_entries(folder, names, manifest, summary))
    if summary is not None and (why := _contradiction(manifest, summary, entries)):
        problems.append(f"summary.json is of other flights: {why}")
        summary = None
    elif summary is not None and requirements and not _is_acceptance_met(summary, requirements):
        problems.append(
            "summary.json is damaged: it says accepted, and its runs do not meet what the campaign "
            "requires"
        )
        summary = None
    if not entries:
        problems.append("no run was started in this folder")
    unfinished = sum(entry.result is None for entry in entries)
    if unfinished:
        problems.append(f"{unfinished} of {len(entries)} runs have no readable result")
    named = manifest.get("campaign")
    name = named if isinstance(named, str) else summary.campaign if summary else folder.name
    return CampaignDocuments(
        name=name,
        folder=folder.name,
        entries=entries,
        summary=summary,
        manifest=manifest,
        requirements=requirements,
        problems=tuple(problems),
    )


def _require_campaign(folder: Path) -> None:
    if not folder.exists():
        raise ResultsFolderError(f"{folder} does not exist; give the results folder of a campaign")
    if not folder.is_dir():
        raise ResultsFolderError(f"{folder} is a file; give the results folder of a campaign")
    if any(folder.glob(_OF_A_SEARCH)):
        raise ResultsFolderError(
            f"{folder} is the folder of a search, whose campaigns are below flights; its "
            "report.html is written by `wil-campaign search`, with --resume once more"
        )
    if any((folder / name).is_file() for name in ("campaign.json", "summary.json")):
        return
    if any(_run_names_on_disk(folder)):
        return
    if any((folder / name).is_file() for name in _OF_A_RUN):
        raise ResultsFolderError(
            f"{folder} is the folder of one run; give the campaign's folder, three levels above"
        )
    newest = max(folder.glob("*/campaign.json"), default=None)
    hint = "" if newest is None else f"; did you mean {newest.parent}?"
    raise ResultsFolderError(
        f"{folder} is not the results folder of a campaign: it has no campaign.json and no "
        f"runs{hint}"
    )


def _run_names(manifest: dict[str, Any], summary: Summary | None) -> dict[str, None]:
    """Return the runs that count by the campaign's documents; none where both are unreadable."""
    names = dict.fromkeys(_names_in(manifest))
    if summary is not None:
        flown = map(_name_of, (*summary.runs, *summary.controls))
        due = dict.fromkeys((*flown, *summary.not_flown))
        names |= due
        if _names_missing(summary):
            names = {name: None for name in names if name in due}
    return {name: None for name in names if _is_run_name(name)}


def _entries(
    folder: Path, names: Iterable[str], manifest: dict[str, Any], summary: Summary | None
) -> Iterator[RunEntry]:
    flown = () if summary is None else (*summary.runs, *summary.controls)
    summarised = {_name_of(run): run for run in flown}
    orders, seeds = _open_orders(folder), _seeds_in(manifest)
    for name in names:
        case, mode, rep = name.split("/")
        problems: list[str] = []
        path = folder / name / "result.json"
        result = _read_document(path, lambda text: _validate(result_model(), text), problems)
        if result is not None and (
            _name_of(result) != name or seeds.get(name, result.seed) != result.seed
        ):
            problems.append(
                f"result.json is of another run: {_name_of(result)} with seed {result.seed}"
            )
            result = None
        if not path.exists() and (name in orders or _is_begun(folder / name)):
            problems.append(_BEGUN)
        yield RunEntry(name, case, mode, rep, result or summarised.get(name), tuple(problems))


def _contradiction(manifest: dict[str, Any], summary: Summary, entries: Iterable[RunEntry]) -> str:
    """Return in words what a summary says of other flights than those in its folder."""
    if manifest.get("campaign", summary.campaign) != summary.campaign:
        return f"of the campaign {summary.campaign}"
    stated = {_name_of(run): run for run in (*summary.runs, *summary.controls)}
    others = [
        _difference(one.name, stated[one.name], one.result)
        for one in entries
        if one.result is not None and one.name in stated
    ]
    return "; ".join(filter(None, others))


def _is_acceptance_met(summary: Summary, requirements: Sequence[PassRequirement]) -> bool:
    """Return whether the runs of a summary are accepted, where it says so.

    broken: of an earlier version, which did not record it, it is not known.
    """
    runs = (*summary.runs, *summary.controls)
    accepted = is_campaign_accepted(
        runs, requirements, stopped=summary.stopped, broken=bool(summary.broken)
    )
    return not summary.accepted or accepted is True


def _difference(name: str, stated: RunResult, result: RunResult) -> str:
    """Return in words how a summary's entry of a run differs from its result; "" if it does not."""
    if stated.verdict != result.verdict:
        return f"{name} is {stated.verdict} there and {result.verdict} in its result.json"
    same = is_same_result(stated, result)
    return "" if same else f"{name} has other figures there than in its result.json"


def _name_of(run: RunResult) -> str:
    return f"{run.case}/{run.mode}/{run.rep}"


def _open_orders(folder: Path) -> frozenset[str]:
    """Return the runs without an outcome in the campaign's ledger; none if it is unreadable."""
    try:
        return frozenset(open_orders(folder))
    except OSError:
        return frozenset()


def _is_begun(home: Path) -> bool:
    try:
        return any(home.iterdir())
    except OSError:
        return False


def _names_in(manifest: dict[str, Any]) -> Iterator[str]:
    runs = manifest.get("runs")
    for run in runs if isinstance(runs, list) else ():
        if isinstance(run, dict) and isinstance(run.get("run"), str):
            yield run["run"]


def _seeds_in(manifest: dict[str, Any]) -> dict[str, int]:
    runs = manifest.get("runs")
    return {
        str(run.get("run")): run["seed"]
        for run in (runs if isinstance(runs, list) else ())
        if isinstance(run, dict) and isinstance(run.get("seed"), int)
    }


def _names_missing(summary: Summary) -> bool:
    """Return whether a summary names all due runs without a result; earlier versions did not.

    The others are not due: those after a decision, for example.
    """
    return summary.broken is not None or bool(summary.not_flown)


def _run_names_on_disk(folder: Path) -> Iterator[str]:
    for mode in MODES:
        for path in sorted(folder.glob(f"*/{mode}/*")):
            if any((path / name).is_file() for name in _OF_A_RUN):
                yield path.relative_to(folder).as_posix()


def _is_run_name(name: str) -> bool:
    """Return whether a name is case/mode/repetition, and no path elsewhere."""
    parts = name.split("/")
    plain = all(part and part not in {".", ".."} and "\0" not in part for part in parts)
    is_short = all(len(part.encode()) <= _LONGEST_NAME for part in parts)
    return len(parts) == 3 and plain and is_short and parts[1] in MODES


def _manifest_problems(manifest: dict[str, Any]) -> Iterator[str]:
    """Yield what campaign.json lacks, and its run names that are invalid."""
    lacking = [
        name for name, kind in _OF_THE_MANIFEST.items() if not isinstance(manifest.get(name), kind)
    ]
    if lacking:
        yield (
            "campaign.json is damaged or of another version: it lacks "
            f"{', '.join(lacking)}, or they have the wrong type"
        )
    runs = manifest.get("runs")
    named = [*_names_in(manifest)]
    foreign = [name for name in named if not _is_run_name(name)]
    count = (len(runs) if isinstance(runs, list) else 0) - len(named) + len(foreign)
    if count:
        examples = ", ".join(repr(name[:_SHOWN]) for name in foreign[:3])
        yield (
            f"campaign.json has {count} runs that are not named case/mode/repetition"
            f"{f': {examples}' if examples else ''}; they are left out"
        )


def _read_requirements(
    manifest: dict[str, Any], problems: list[str]
) -> tuple[PassRequirement, ...]:
    try:
        return flown_requirements(manifest)
    except RequirementsError as error:
        problems.append(f"campaign.json is damaged or of another version: {error}")
        return ()


def _read_document(path: Path, parse: Callable[[str], T], problems: list[str]) -> T | None:
    try:
        data = read_limited_data(path)
        check_json_values(data)
        return parse(data.decode("utf-8", errors="replace"))
    except UnreadableError as error:
        problems.append(str(error))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        why = f"{where}: {first['msg']}" if where else first["msg"]
        problems.append(f"{path.name} is truncated, damaged or of another version: {why}")
    except (ValueError, RecursionError) as error:
        problems.append(f"{path.name} is truncated or damaged: {error}")
    return None


def read_limited_data(path: Path) -> bytes:
    """Return the bytes of a file, up to a limit. Raises UnreadableError."""
    try:
        if path.exists() and not path.is_file():
            raise UnreadableError(f"{path.name} is not a file")
        return read_limited_bytes(path)
    except JsonLimitError as error:
        raise UnreadableError(f"{path.name} cannot be read: {error}") from error
    except FileNotFoundError as error:
        raise UnreadableError(f"{path.name} is missing") from error
    except OSError as error:
        raise UnreadableError(f"{path.name} cannot be read: {error.strerror or error}") from error


def _validate(model: TypeAdapter[T], text: str) -> T:
    found = model.validate_json(text)
    _load_json(text)
    return found


def _load_json(text: str) -> Any:
    """Return a JSON value. Raises ValueError for NaN and infinities, which JSON does not have."""
    return json.loads(text, parse_constant=_refuse_constant, parse_float=_finite)


def _refuse_constant(text: str) -> None:
    raise ValueError(f"{text} is not a number")


def _finite(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise ValueError(f"{text} is too large for a number")
    return number


def _mapping(text: str) -> dict[str, Any]:
    found = _load_json(text)
    if not isinstance(found, dict):
        raise ValueError("it is not a JSON object")  # noqa: TRY004 - a document, not an argument
    # Half a surrogate pair is valid JSON, but cannot be encoded as UTF-8.
    whole = json.dumps(found, ensure_ascii=False).encode("utf-8", errors="replace")
    replaced: dict[str, Any] = json.loads(whole)
    return replaced


class RequirementsError(Exception):
    """The requirements of a manifest are damaged; the message says where."""


@cache
def _model() -> TypeAdapter[tuple[PassRequirement, ...]]:
    return TypeAdapter(tuple[PassRequirement, ...])


def flown_requirements(manifest: Mapping[str, Any]) -> tuple[PassRequirement, ...]:
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


def _requirements_of_document(manifest: Mapping[str, Any]) -> Iterator[PassRequirement]:
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
            yield PassRequirement(case, mode, PassShare(test.most, test.most), test)
    elif isinstance(repetitions, int) and isinstance(document.get("accept"), dict):
        for case, shares in document["accept"].items():
            for mode, text in shares.items() if isinstance(shares, dict) else ():
                if (share := _share(text)) is not None:
                    yield PassRequirement(case, mode, share.scaled(repetitions))


def _test(repetitions: Mapping[str, Any]) -> SequentialTest | None:
    try:
        return UntilDecidedPart.model_validate(repetitions).test
    except ValueError:
        return None


def _share(text: object) -> PassShare | None:
    try:
        return parse_pass_share(text) if isinstance(text, str) else None
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
