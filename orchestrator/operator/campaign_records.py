"""Records of the campaigns in flight on this machine, beside the records of their guards."""

import contextlib
import os
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import msgspec

from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.safety.guard.process.orphaned_processes import running_guards
from wil_campaign.safety.guard.process.runtime_folder import (
    is_socket_served,
    open_runtime_folder,
    process_socket_path,
    runtime_folders,
    sweep_runtime_folder,
)

_POLL_S = 0.01


@dataclass(frozen=True, slots=True)
class OperatorPlace:
    """A socket that takes operator commands. folder: of the results; name: for messages.

    process: the one that listens there, to be signalled when the socket does not answer; None for
    a campaign of a container, whose process ids are others.
    campaign: of a guard, the folder of its run's campaign; None where it is of none.
    record: the file of a campaign's record, which is there while it flies; None of a guard.
    """

    name: str
    folder: Path
    socket: Path
    process: ProcessId | None = None
    campaign: Path | None = None
    record: Path | None = None

    def has_ended(self, *, within_s: float) -> bool:
        """Return whether a campaign's flights are over: its record is gone, or goes in time."""
        if self.record is None:
            return False
        until_s = time.monotonic() + within_s
        while self.record.exists():
            if time.monotonic() > until_s:
                return False
            time.sleep(_POLL_S)
        return True

    def is_beneath(self, folder: Path) -> bool:
        """Return whether this is a campaign's, or of one of its runs, by the campaign's folder."""
        return self.folder.is_relative_to(folder) or self.campaign == folder


@dataclass(frozen=True, slots=True)
class OperatorPlaces:
    """The records of campaigns in flight on this machine, and of the guards of their runs."""

    campaigns: tuple[OperatorPlace, ...]
    guards: tuple[OperatorPlace, ...]

    def beneath(self, folder: Path | None) -> "OperatorPlaces":
        """Return the records of one results folder, a campaign's or a run's; all for None."""
        if folder is None:
            return self
        found = self._beneath(folder.absolute(), lambda recorded: recorded)
        if found.campaigns or found.guards:
            return found
        # By another name, as behind a link. Last, for a disk in the network may not answer.
        return self._beneath(real_folder(folder), real_folder)

    def _beneath(self, wanted: Path, name: Callable[[Path], Path]) -> "OperatorPlaces":
        """Return the records of a folder. name: returns a recorded folder as `wanted` is named."""
        return OperatorPlaces(
            tuple(one for one in self.campaigns if related_folder(name(one.folder), wanted)),
            tuple(
                guard
                for guard in self.guards
                if related_folder(name(guard.folder), wanted)
                or (guard.campaign is not None and name(guard.campaign).is_relative_to(wanted))
            ),
        )

    def guards_of(self, campaign: OperatorPlace) -> tuple[OperatorPlace, ...]:
        """Return the guards' records of a campaign's runs."""
        return tuple(guard for guard in self.guards if guard.is_beneath(campaign.folder))

    def by_campaign(self) -> dict[Path, "OperatorPlaces"]:
        """Return the records by the results folder of their campaign.

        Programs and guards of one folder are one campaign, also where the program has ended.
        """
        folders = dict.fromkeys(campaign.folder for campaign in self.campaigns)
        owners = {guard: _campaign_folder(guard, folders) for guard in self.guards}
        return {
            folder: OperatorPlaces(
                tuple(campaign for campaign in self.campaigns if campaign.folder == folder),
                tuple(guard for guard in self.guards if owners[guard] == folder),
            )
            for folder in folders | dict.fromkeys(owners.values())
        }

    def __or__(self, other: "OperatorPlaces") -> "OperatorPlaces":
        """Return the records of both."""
        return OperatorPlaces(self.campaigns + other.campaigns, self.guards + other.guards)


def operator_places() -> OperatorPlaces:
    """Return the records of this user's flights on this machine. Raises OSError."""
    folders = runtime_folders()
    guards = [
        OperatorPlace(
            guard_record.run,
            Path(guard_record.folder),
            Path(guard_record.socket),
            guard_record.guard,
            Path(guard_record.campaign) if guard_record.campaign else None,
        )
        for folder in folders
        for guard_record in running_guards(folder)
    ]
    campaigns = [campaign for folder in folders for campaign in _campaigns(folder)]
    return OperatorPlaces(tuple(campaigns), tuple(guards))


@dataclass(frozen=True, slots=True)
class _Entry:
    """The content of a campaign record's file."""

    name: str
    folder: str
    socket: str
    process: ProcessId


class CampaignRecord:
    """Registers a campaign as in flight on this machine; a context manager. Raises OSError.

    passed_over: messages about socket folders that are unsafe and were not used.
    """

    def __init__(self, *, name: str, folder: Path) -> None:
        opened = open_runtime_folder()
        runtime = opened.path
        sweep_runtime_folder(runtime)
        self.passed_over = tuple(f"{text}; {runtime} is used" for text in opened.passed_over)
        process = ProcessId.own()
        self.socket = process_socket_path(runtime, "campaign", process)
        self._path = self.socket.with_suffix(".json")
        self._entry = _Entry(name, str(folder.absolute()), str(self.socket), process)

    def __enter__(self) -> Self:
        self.socket.unlink(missing_ok=True)
        part = self._path.with_suffix(".part")
        part.write_bytes(msgspec.json.encode(self._entry))
        part.replace(self._path)
        return self

    def __exit__(self, *_: object) -> None:
        self._path.unlink(missing_ok=True)


def related_folder(one: Path, other: Path) -> bool:
    """Return whether one recorded folder contains the other."""
    return one.is_relative_to(other) or other.is_relative_to(one)


def real_folder(folder: Path) -> Path:
    """Return a folder by the name that it has without links."""
    return Path(os.path.realpath(folder))


def _campaign_folder(guard: OperatorPlace, campaigns: Iterable[Path]) -> Path:
    """Return the results folder of a guard's campaign; its run's where it is of none."""
    holding = [campaign for campaign in campaigns if guard.is_beneath(campaign)]
    return max(holding, key=lambda one: len(one.parts), default=guard.campaign or guard.folder)


def _campaigns(runtime: Path) -> Iterator[OperatorPlace]:
    for path in sorted(runtime.glob("campaign-*.json")):
        with contextlib.suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError):
            entry = msgspec.json.decode(path.read_bytes(), type=_Entry)
            process = entry.process if entry.process.lives else None
            if process is not None or is_socket_served(Path(entry.socket)):
                yield OperatorPlace(
                    entry.name, Path(entry.folder), Path(entry.socket), process, record=path
                )
            else:
                path.unlink()
                Path(entry.socket).unlink(missing_ok=True)
