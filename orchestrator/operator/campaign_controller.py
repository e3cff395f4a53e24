"""The campaign controller: executes operator commands from every operator channel."""

from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from threading import Thread
from typing import Any, Protocol

from wil_campaign.foundation.tasks import SuppressedErrors
from wil_campaign.orchestrator.operator.acknowledgements import AcknowledgedRuns, Acknowledgements
from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace
from wil_campaign.orchestrator.operator.operator_log import OperatorLog
from wil_campaign.orchestrator.operator.run_messages import (
    FlightPlace,
    News,
    RunEventReport,
    RunProgressReport,
)
from wil_campaign.orchestrator.operator.socket_client import tell_operator_socket
from wil_campaign.orchestrator.run_results.run_result import RunResult, Stop
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError

_MOST_ANSWERS = 20
PERSON_AWAITED = "repositioning"
"""Holds a campaign while a person moves the vehicle; the hold of an operator takes its place."""


class WorkerFleet(Protocol):
    """The workers that fly a campaign, as the controller commands them (protocol)."""

    def abort(self, command: OperatorCommand) -> None:
        """Land every run in flight as aborted, and start no other."""

    def pass_on(self, command: OperatorCommand) -> int:
        """Pass an operator command to every run in flight that it is for; return how many."""

    def pause(self) -> None:
        """Start no run until `go_on`."""

    def go_on(self) -> None:
        """Start runs again."""


class ProgressFollower(Protocol):
    """Receives the progress of a campaign from its controller (protocol)."""

    def news(self, news: News) -> None:
        """Receive news of a run from the campaign controller."""

    def finished(self, result: RunResult) -> None:
        """Receive a run's verdict from the campaign controller."""

    def status(self) -> None:
        """Receive notice that the campaign's status has changed."""


class CampaignController:
    """Executes operator commands on a campaign: abort, hold, resume, fence.

    An abort goes to the runs, and then directly to the campaign's guards, because a run may hang. A
    thread looks for the guards: a home folder on the network may not answer. say: prints a message
    on the terminal.
    """

    def __init__(
        self,
        *,
        campaign: str,
        folder: Path,
        total: int,
        fleet: WorkerFleet,
        say: Callable[[str], None],
    ) -> None:
        self.campaign = campaign
        self.folder = folder
        self._total = total
        self._fleet = fleet
        self.guards: Callable[[], Sequence[OperatorPlace]] = tuple
        self._say = say
        self._followers: list[ProgressFollower] = []
        self._flying: dict[str, RunProgressReport] = {}
        self._verdicts: dict[str, str] = {}
        self._places: dict[str, FlightPlace] = {}
        self._seen_places: set[FlightPlace] = set()
        self._acknowledgements = Acknowledgements()
        self._numbers = count(1)
        self._partial_aborts: list[OperatorCommand] = []
        """Aborts of one node or bench."""
        self._answers: deque[RunEventReport] = deque(maxlen=_MOST_ANSWERS)
        self.log = OperatorLog(path=folder / "operator.jsonl")
        self.held_by = ""
        """Who holds the campaign; empty while nobody does."""
        self._holding: set[str] = set()
        """The runs in flight that hold."""
        self.stopped: Stop | None = None

    @property
    def session(self) -> str:
        """Return the name of the results folder, which identifies this start of the campaign."""
        return self.folder.name

    @property
    def flying(self) -> Collection[str]:
        """Return the controlled campaign's runs in flight."""
        return self._flying.keys()

    @property
    def held(self) -> bool:
        """Return whether the controlled campaign starts no run until it is resumed."""
        return self.held_by != ""

    @property
    def state(self) -> str:
        """Return the controlled campaign's state: flying, held or landing."""
        if self.stopped is not None:
            return "landing"
        return "held" if self.held else "flying"

    @property
    def acknowledged(self) -> AcknowledgedRuns | None:
        """Return the acknowledgements of the newest command; None before the first."""
        return self._acknowledgements.newest

    def follow(self, follower: ProgressFollower) -> None:
        """Register a follower of the campaign."""
        self._followers.append(follower)

    @property
    def ended_by(self) -> Stop | None:
        """Return what stopped the campaign, or parts of it; None where nothing did."""
        return self.stopped or ("command" if self._partial_aborts else None)

    def begun(self, run: str, place: FlightPlace) -> None:
        """Record that a run has started, and where."""
        self._places[run] = place
        self._seen_places.add(place)
        self._holding.discard(run)  # an earlier attempt at this run may have held

    def obey(self, command: OperatorCommand, *, stop: Stop = "command") -> str:
        """Execute an operator's command; return what was done. Raises RefusedLineError."""
        if not command.command_id:
            command = replace(command, command_id=f"{self.session}/{next(self._numbers)}")
        try:
            done = self._execute(command, stop)
        except RefusedLineError as error:
            self.log.write(command, ok=False, text=str(error))
            raise
        self.log.write(command, ok=True, text=done)
        self._send_status()
        self._say(f"{command.kind} by {command.who}: {done}")
        return done

    def warn(self, text: str) -> None:
        """Log a problem of an operator channel, and print it on the terminal."""
        self.log.note(text)
        self._say(text)

    def signal(self, name: str) -> None:
        """Handle Ctrl-C or SIGTERM: an abort; a second one changes nothing."""
        if self.stopped is not None:
            self._say("still landing; the program ends when the vehicles are down")
            return
        self.obey(OperatorCommand("abort", name), stop="signal")

    def news(self, news: News) -> None:
        """Handle news of a run, and pass it to followers."""
        if isinstance(news, RunProgressReport):
            self._flying[news.run] = news
        elif news.kind == "answer":
            self._receive_answer(news)
        elif news.kind == "acknowledged":
            self._acknowledgements.acknowledge(news.run, news.command_id)
        for follower in self._followers:
            with SuppressedErrors("news for operators"):
                follower.news(news)

    def _receive_answer(self, news: RunEventReport) -> None:
        """Record a run's delayed reply to an operator's command."""
        command = OperatorCommand("geofence", news.who)
        self.log.write(command, ok=news.word == "ok", text=f"{news.run}: {news.text}")
        self._say(f"{news.run}: {news.text}")
        self._answers.append(news)

    def finished(self, run: RunResult, *, may_end: bool = True) -> None:
        """Handle a run's verdict; a run aborted by an operator or pilot ends the campaign.

        may_end: False for a run that was planned to end before arming.
        """
        name = f"{run.case}/{run.mode}/{run.rep}"
        place = self._forget_run(name)
        self._verdicts[name] = run.verdict
        is_partial = any(
            place.is_meant(node=partial_abort.node, bench=partial_abort.bench)
            for partial_abort in self._partial_aborts
        )
        if may_end and run.verdict == "ABORTED" and self.stopped is None and not is_partial:
            self.stopped = "command"
            self._fleet.abort(OperatorCommand("abort", f"{name} ({run.reason})"))
        for follower in self._followers:
            with SuppressedErrors("a verdict for operators"):
                follower.finished(run)
        self._send_status()

    def left(self, name: str) -> None:
        """Record that a flight between runs is over."""
        self._forget_run(name)
        self._send_status()

    def _forget_run(self, name: str) -> FlightPlace:
        """Remove a run from those in flight; return where it flew."""
        self._flying.pop(name, None)
        self._acknowledgements.ended(name)
        self._holding.discard(name)
        return self._places.pop(name, FlightPlace())

    def summary(self, state: str) -> dict[str, Any]:
        """Return the controlled campaign's status without its runs in flight."""
        return {
            "state": state,
            "campaign": self.campaign,
            "session": self.session,
            "held": self.held,
            "stopped": self.stopped,
            "total": self._total,
            "finished": dict(self._verdicts),
        }

    def status(self) -> dict[str, Any]:
        """Return the controlled campaign's status."""
        flying = {
            name: {**_plain(progress), "place": str(self._places.get(name, ""))}
            for name, progress in self._flying.items()
        }
        answers = [
            {
                "id": answer.command_id,
                "run": answer.run,
                "ok": answer.word == "ok",
                "text": answer.text,
            }
            for answer in self._answers
        ]
        return {
            **self.summary(self.state),
            "folder": str(self.folder),
            "flying": flying,
            "answers": answers,
            "acknowledged": None if self.acknowledged is None else self.acknowledged.plain(),
        }

    def _send_status(self) -> None:
        for follower in self._followers:
            with SuppressedErrors("the status for operators"):
                follower.status()

    def _execute(self, command: OperatorCommand, stop: Stop) -> str:
        match command.kind:
            case "abort":
                return self._abort(command, stop)
            case "hold":
                return self._hold(command)
            case "resume":
                return self._resume(command)
            case "geofence":
                return self._change_fences(command)

    def _abort(self, command: OperatorCommand, stop: Stop) -> str:
        if command.is_partial:
            return self._abort_place(command)
        self._expect(command)
        was_stopped, self.stopped, self.held_by = self.stopped, self.stopped or stop, ""
        try:
            self._fleet.abort(command)
        except BaseException:
            self.stopped = was_stopped  # a further abort tries again
            raise
        finally:
            self._begin_abort_of_guards(command.who)
        for_all = "; an abort is for all runs, not only for the one that it names"
        more = for_all if command.run else ""
        if was_stopped is not None:
            return f"all vehicles are landing already{more}"
        return f"all vehicles land, and no further run is flown{more}"

    def _begin_abort_of_guards(self, who: str) -> None:
        """Tell the guards of an abort in a thread; at once where the system starts none."""
        thread = Thread(target=self._tell_guards, args=(who,), name="abort of guards", daemon=True)
        try:
            thread.start()
        except RuntimeError:
            self._tell_guards(who)

    def _tell_guards(self, who: str) -> None:
        for guard in self.guards():
            tell_operator_socket(guard.socket, "abort", who=who)

    def _abort_place(self, command: OperatorCommand) -> str:
        """Land the runs on one node or bench, if any fly, and start no other run there."""
        what = f"bench {command.bench}" if command.bench else f"node {command.node}"
        if not any(
            place.is_meant(node=command.node, bench=command.bench) for place in self._seen_places
        ):
            there = ", ".join(sorted({str(place) for place in self._seen_places} - {""})) or "none"
            raise RefusedLineError(
                f"abort: no run flies on {what}; nodes and benches with runs: {there}"
            )
        meant = self._expect(command)
        self._partial_aborts.append(command)
        self._fleet.abort(command)
        return f"{_runs(len(meant))} on {what} will land, and no further run is flown there"

    def _expect(self, command: OperatorCommand) -> Mapping[str, FlightPlace]:
        """Return the runs that a command is for, and await their acknowledgements."""
        meant = {
            run: place
            for run, place in self._places.items()
            if place.is_meant(node=command.node, bench=command.bench) and command.is_for(run)
        }
        self._acknowledgements.expect(command, meant)
        return meant

    def _hold(self, command: OperatorCommand) -> str:
        self._refuse_when_stopped(command)
        meant = {command.run} if command.run else set(self._places)
        if meant <= self._holding and (command.run or self.held_by not in {"", PERSON_AWAITED}):
            who = f"{command.run} holds" if command.run else "all vehicles hold"
            raise RefusedLineError(f"hold: {who} already")
        self._holding |= meant
        self._expect(command)
        if command.run:
            return f"held: {_runs(self._fleet.pass_on(command))} in flight, {command.run} only"
        self.held_by = command.who
        self._fleet.pause()
        return f"held: {_runs(self._fleet.pass_on(command))} in flight; no run is started"

    def _resume(self, command: OperatorCommand) -> str:
        self._refuse_when_stopped(command)
        if command.run:
            return self._resume_run(command)
        if not self.held and not self._holding:
            raise RefusedLineError("resume: no vehicle holds")
        self.held_by = ""
        self._holding.clear()
        self._expect(command)
        self._fleet.go_on()
        return f"resumed: {_runs(self._fleet.pass_on(command))} in flight"

    def _resume_run(self, command: OperatorCommand) -> str:
        """Resume one run; a held campaign starts no other before all are resumed."""
        if command.run not in self._holding:
            raise RefusedLineError(f"resume: {command.run} does not hold")
        self._holding.remove(command.run)
        self._expect(command)
        more = "; no run is started until a resume of all" if self.held else ""
        return f"resumed: {_runs(self._fleet.pass_on(command))} in flight, {command.run} only{more}"

    def _change_fences(self, command: OperatorCommand) -> str:
        self._refuse_when_stopped(command)
        if not self._flying:
            raise RefusedLineError("geofence: no vehicle in flight has a fence that can be changed")
        count = self._fleet.pass_on(command)
        return f"sent to {_runs(count)}; each run will report its result"

    def _refuse_when_stopped(self, command: OperatorCommand) -> None:
        if self.stopped is not None:
            raise RefusedLineError(f"{command.kind}: all vehicles are landing already")


def _runs(count: int) -> str:
    return f"{count} run" if count == 1 else f"{count} runs"


def _plain(progress: RunProgressReport) -> dict[str, Any]:
    return {
        "stage": progress.stage,
        "t_s": round(progress.t_s, 3),
        "clearance_m": progress.clearance_m,
        "verdict_so_far": progress.verdict_so_far,
    }
