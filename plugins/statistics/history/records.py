"""The history file: one JSON line per flight, taken from results folders.

The file is appended to and outlives the folders: a CI job keeps it instead of the recordings. The
last line of a flight counts: its campaign may have been resumed, and the flight flown again.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from wil_campaign.orchestrator.reading.model import CampaignDocuments, RunEntry
from wil_campaign.orchestrator.run_results.control_results import control_faults
from wil_campaign.orchestrator.run_results.result_parts import FlownFirmware
from wil_campaign.orchestrator.run_results.run_result import RunResult, tightest_oracle
from wil_campaign.plugins.statistics.comparison.settings import manifest_settings

_MOST_BYTES = 256 * 1024 * 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRecord:
    """One flight of the history.

    inputs: a digest of all files read, of the versions and of the firmware; a flight with the same
    seed and inputs is a repetition. settings: a digest of those of its campaign's test, without the
    subject; empty in lines of earlier versions. firmware: of the vehicles, in words; empty in those
    too. margin: the smallest of the judged vehicle's required oracles in metres, in any unit where
    no flight of the case and mode has one in metres; None without one. ending: why its campaign
    ended early, and its controls that did not end as expected, so that its passes show nothing;
    else empty; None where that was not recorded. host: the name of the machine; empty in lines of
    earlier versions. plan: a digest of the files and versions of the run's campaign; empty in those
    too.
    """

    campaign: str
    started_utc: str
    clock: str
    version: str
    case: str
    mode: str
    rep: str
    seed: int
    inputs: str
    verdict: str
    margin: float | None
    duration_s: float | None
    ending: str | None = None
    host: str = ""
    settings: str = ""
    firmware: str = ""
    plan: str = ""


@cache
def _record_model() -> TypeAdapter[FlightRecord]:
    return TypeAdapter(FlightRecord)


class HistoryFileError(Exception):
    """A history file cannot be read or written; the message says which and why."""


def flight_records_of(documents: CampaignDocuments) -> Iterator[FlightRecord]:
    """Yield the flights of a results folder; controls and runs without a result are left out."""
    manifest = documents.manifest
    versions = manifest.get("versions")
    version = versions.get("wil-campaign") if isinstance(versions, dict) else None
    host = manifest.get("host")
    machine = host.get("name") if isinstance(host, dict) else None
    in_metres = {
        (entry.case, entry.mode)
        for entry in documents.entries
        if entry.result is not None and _metres_of(entry.result) is not None
    }
    ending = _ending(documents)
    for entry in documents.entries:
        if entry.result is None or entry.result.control is not None:
            continue
        yield FlightRecord(
            campaign=documents.name,
            started_utc=str(manifest.get("started_utc") or documents.folder),
            clock=str(manifest.get("clock") or "unknown"),
            version=str(version or "unknown"),
            case=entry.case,
            mode=entry.mode,
            rep=entry.rep,
            seed=entry.result.seed,
            inputs=_inputs(documents, entry),
            settings=_digest(manifest_settings(manifest)),
            verdict=entry.result.verdict,
            margin=_margin(entry.result, in_metres=(entry.case, entry.mode) in in_metres),
            duration_s=entry.result.duration_s,
            ending=ending,
            host=str(machine or ""),
            firmware=_firmware_text(entry.result),
            plan=_digest(_plan(documents, entry)),
        )


def read_records(path: Path) -> list[FlightRecord]:
    """Return the lines of a history file as flights (see `latest`); empty without the file.

    Raises HistoryFileError, with the line.
    """
    try:
        if not path.exists():
            return []
        if not path.is_file():
            raise HistoryFileError(f"{path} is not a file")
        if path.stat().st_size > _MOST_BYTES:
            raise HistoryFileError(f"{path} is larger than {_MOST_BYTES} bytes")
        lines = path.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise HistoryFileError(f"{path} cannot be read: {error}") from error
    found = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            found.append(_record_model().validate_json(line))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise HistoryFileError(
                f"{path}:{number} is damaged, or not a history line: {where} {first['msg']}"
            ) from error
    return found


def append_records(path: Path, records: Iterable[FlightRecord]) -> None:
    """Append flights to a history file, all or none. Raises HistoryFileError."""
    data = "".join(json.dumps(asdict(record)) + "\n" for record in records).encode()
    try:
        with path.open("a+b", buffering=0) as stream:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(max(0, size - 1))
            rest = memoryview(data if stream.read(1) in {b"", b"\n"} else b"\n" + data)
            try:
                while rest:
                    rest = rest[stream.write(rest) :]
            except OSError:
                stream.truncate(size)
                raise
    except OSError as error:
        raise HistoryFileError(f"{path} cannot be written: {error.strerror or error}") from error


def latest_records(records: Iterable[FlightRecord]) -> list[FlightRecord]:
    """Return the last record of each flight, in the order of these."""
    found: dict[tuple[str, ...], FlightRecord] = {}
    for record in records:
        # A line of an earlier version has no plan, or no host either: this is the same flight.
        for earlier in (replace(record, plan=""), replace(record, plan="", host=""), record):
            found.pop(_flight_key(earlier), None)
        found[_flight_key(record)] = record
    return list(found.values())


def _flight_key(one: FlightRecord) -> tuple[str, ...]:
    """Return the key that identifies a flight.

    Two machines may start in the same second, and so may one, with other seeds or options.
    """
    campaign = (
        one.campaign,
        one.started_utc,
        one.host,
        one.plan,
        str(one.seed) if one.plan else "",
    )
    return (*campaign, one.case, one.mode, one.rep)


def _plan(documents: CampaignDocuments, entry: RunEntry) -> list[object]:
    """Return a run's documents, all files of the campaign, and all versions."""
    manifest = documents.manifest
    host = manifest.get("host")
    machine = host.get("machine") if isinstance(host, dict) else None
    own = _documents(documents, entry)
    return [own, manifest.get("files"), manifest.get("versions"), machine, manifest.get("clock")]


def _inputs(documents: CampaignDocuments, entry: RunEntry) -> str:
    """Return the digest of a run's plan and of the firmware that flew."""
    read = _plan(documents, entry)
    firmware = () if entry.result is None else entry.result.firmware
    # A result of an earlier version has none: its digest stays what a history file has.
    return _digest([*read, *map(_firmware_inputs, firmware)])


def _firmware_inputs(one: FlownFirmware) -> list[object]:
    return [one.vehicle, *one.kind, one.parameters, one.unit]


def _firmware_text(run: RunResult) -> str:
    """Return the firmware of a run's vehicles in words, without their units."""
    return "; ".join(
        f"{flown.vehicle}: {flown.release}, {flown.board}, {flown.frame}" for flown in run.firmware
    )


def _documents(documents: CampaignDocuments, entry: RunEntry) -> list[object]:
    runs = documents.manifest.get("runs")
    return [
        run.get("documents")
        for run in (runs if isinstance(runs, list) else ())
        if isinstance(run, dict) and run.get("run") == entry.name
    ]


def _digest(read: object) -> str:
    """Return a short digest of plain values."""
    text = json.dumps(read, sort_keys=True, default=str)
    return hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()[:16]


def _ending(documents: CampaignDocuments) -> str | None:
    """Return why a campaign ended early, and its unmet controls; None where it is unknown."""
    if documents.summary is None:
        return None
    unmet = control_faults(entry.result for entry in documents.entries if entry.result)
    return "; ".join(text for text in (documents.summary.ending, *unmet) if text)


def _margin(run: RunResult, *, in_metres: bool) -> float | None:
    """Return a run's smallest margin. in_metres: of those in metres alone.

    A flight that came near nothing has none in metres: its seconds are not to stand among them.
    """
    if in_metres:
        return _metres_of(run)
    tightest = tightest_oracle(run)
    return None if tightest is None else tightest.margin


def _metres_of(run: RunResult) -> float | None:
    """Return the smallest margin in metres, which flights can be compared by; None without one."""
    in_metres = tuple(oracle for oracle in run.oracles if oracle.unit == "m")
    tightest = tightest_oracle(replace(run, oracles=in_metres))
    return None if tightest is None else tightest.margin
