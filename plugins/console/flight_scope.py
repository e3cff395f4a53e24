"""The flights of this machine that a console or a Foxglove bridge shows and commands."""

from pathlib import Path

from wil_campaign.orchestrator.operator.campaign_records import (
    OperatorPlaces,
    operator_places,
    real_folder,
    related_folder,
)

_MOST_DECIDED = 1000


class FlightScope:
    """All flights of this user on this machine, or those of one folder or one program.

    folder: only flights that write their results there. program: only the campaign of the process
    with this pid, once it has started; its guards stay in the scope after the process has ended.
    """

    def __init__(self, *, folder: Path | None = None, program: int | None = None) -> None:
        self._folder = None if folder is None else folder.absolute()
        self._program = program
        self._own: frozenset[Path] = frozenset()
        self._decided: dict[str, bool] = {}

    @property
    def is_whole_machine(self) -> bool:
        """Whether the scope has all flights of this machine."""
        return self._folder is None and self._program is None

    def places(self) -> OperatorPlaces:
        """Return the records of the flights in the scope that are in the air. Raises OSError."""
        found = operator_places().beneath(self._folder)
        if self._program is None:
            return found
        mine = {
            campaign.folder
            for campaign in found.campaigns
            if campaign.process is not None and campaign.process.pid == self._program
        }
        self._own |= mine
        return OperatorPlaces(
            tuple(campaign for campaign in found.campaigns if campaign.folder in mine),
            tuple(guard for guard in found.guards if any(map(guard.is_beneath, self._own))),
        )

    def covers(self, run: str) -> bool:
        """Return whether the run with this results folder is in the scope.

        A campaign's record is written before its first run, so that one check per run suffices.
        """
        if run not in self._decided:
            if len(self._decided) >= _MOST_DECIDED:
                self._decided.clear()
            self._decided[run] = self._decide(Path(run))
        return self._decided[run]

    def _decide(self, run: Path) -> bool:
        if self._program is not None and not self._is_own(run):
            try:
                self.places()
            except OSError:
                return False
            if not self._is_own(run):
                return False
        return self._folder is None or related_folder(real_folder(run), real_folder(self._folder))

    def _is_own(self, folder: Path) -> bool:
        return any(folder.is_relative_to(path) for path in self._own)
