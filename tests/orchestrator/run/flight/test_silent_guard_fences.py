"""A guard that is silent when it is to take a fence: what the operator is told is true."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, cast

import pytest

from tests.orchestrator.run.flight.test_fence_changes import TIGHTER
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.flight.fence_changes import FenceChanges
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import NewFences
from wil_campaign.safety.guard.core.events import EventKind, GuardEvent
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.worlds.geodesy import LocalFrame

OLD = Fence.box(north_m=(-9, 9), east_m=(-9, 9), up_m=(-1, 6))
NOT_KNOWN = "it is not known yet whether the new fence applies or the old one"
TAKEN = "anna changed the fence of real"


class AutopilotFences:
    """The autopilots' fences: what is there, and what was offered and is not settled."""

    def __init__(self) -> None:
        self.has = "old"
        self.unsettled: tuple[str, ...] = ()

    async def offer(self, fences: Mapping[str, Fence]) -> None:
        self.has, self.unsettled = "new", tuple(fences)

    async def confirm(self) -> None:
        assert self.unsettled
        self.unsettled = ()

    async def restore(self) -> None:
        if self.unsettled:
            self.has, self.unsettled = "old", ()


class SilentGuard:
    """A guard that answers proposals, and a change when it is told to."""

    def __init__(self, tell: Callable[[EventKind, str], None]) -> None:
        self.tell = tell
        self.answers_proposals = True

    def send(self, command: NewFences) -> None:
        if command.proposed and self.answers_proposals:
            self.tell("proposed", "")


class Rig:
    """Fence changes with a guard that is silent; answers as (ok, text)."""

    def __init__(self) -> None:
        self.aboard = AutopilotFences()
        self.guard = SilentGuard(self.tell)
        self.answers: list[tuple[bool, str]] = []
        self.shown: list[str] = []
        self.changes = FenceChanges(
            guard=cast("Any", self.guard),
            onboard_fences=cast("Any", self.aboard),
            frame=LocalFrame(47.4, 8.5, 488.0),
            fences={"real": OLD},
            flying=("real",),
            changed=lambda fences, _: self.shown.extend(fences),
            answer=lambda _, ok, text: self.answers.append((ok, text)),
        )

    def tell(self, kind: EventKind, text: str) -> None:
        self.changes.receive(GuardEvent(asyncio.get_running_loop().time(), kind, "", text))

    def ask(self, document: str = TIGHTER) -> None:
        self.changes.ask(OperatorCommand("geofence", "anna", document=document, command_id="a1"))


def run(script: Callable[[Rig], Any]) -> Rig:
    """Run a script beside the fence changes, in virtual time."""

    async def both() -> Rig:
        rig = Rig()
        task = asyncio.ensure_future(rig.changes.run())
        try:
            await script(rig)
            await asyncio.sleep(0.1)
        finally:
            task.cancel()
        return rig

    return run_virtual(both())


def test_a_fence_that_the_guard_takes_late_is_the_one_in_force() -> None:
    async def script(rig: Rig) -> None:
        rig.ask()
        await asyncio.sleep(5.0)
        ((ok, text),) = rig.answers
        assert not ok
        assert NOT_KNOWN in text
        assert "applies" in text
        assert (rig.aboard.has, rig.shown) == ("new", []), "which one holds is not known"
        rig.tell("geofence", TAKEN)

    rig = run(script)
    assert rig.answers[1:] == [(True, f"late: {TAKEN}")]
    assert (rig.aboard.has, rig.aboard.unsettled, rig.shown) == ("new", (), ["real"])


@pytest.mark.parametrize(
    ("kind", "text", "said"),
    [
        ("refused", "anna: geofence: all are landing", "; the old fence applies"),
        ("guard", "the guard's process ended", "; the autopilots have the old fence again"),
    ],
)
def test_a_fence_that_the_guard_never_took_is_put_back(
    kind: EventKind, text: str, said: str
) -> None:
    async def script(rig: Rig) -> None:
        rig.ask()
        await asyncio.sleep(5.0)
        rig.tell(kind, text)

    rig = run(script)
    (_, first), (ok, last) = rig.answers
    assert NOT_KNOWN in first
    assert not ok
    assert last.endswith(text + said)
    assert (rig.aboard.has, rig.aboard.unsettled, rig.shown) == ("old", (), [])


def test_a_fence_that_cannot_be_read_says_geofence_once() -> None:
    async def script(rig: Rig) -> None:
        rig.ask("")

    assert run(script).answers == [(False, "geofence: is empty; the old fence applies")]


def test_no_further_fence_is_taken_while_the_last_answer_is_missing() -> None:
    async def script(rig: Rig) -> None:
        rig.ask()
        await asyncio.sleep(5.0)
        rig.ask()
        rig.tell("geofence", TAKEN)
        await asyncio.sleep(0.1)
        rig.ask()
        await asyncio.sleep(0.1)
        rig.tell("geofence", TAKEN)

    said = [text for _, text in run(script).answers]
    assert NOT_KNOWN in said[0]
    assert "in progress" in said[1]
    assert said[2:] == [f"late: {TAKEN}", TAKEN]


def test_an_answer_to_a_proposal_that_was_given_up_is_not_one_to_the_next() -> None:
    async def script(rig: Rig) -> None:
        rig.guard.answers_proposals = False
        rig.ask()
        await asyncio.sleep(5.0)
        rig.ask()
        await asyncio.sleep(0.1)
        rig.tell("refused", "anna: geofence: outside")  # to the first one, which is over
        await asyncio.sleep(0.1)
        assert len(rig.answers) == 1
        rig.tell("proposed", "")
        await asyncio.sleep(0.1)
        rig.tell("geofence", TAKEN)

    rig = run(script)
    assert rig.answers == [
        (False, "geofence: the guard did not answer; the old fence applies"),
        (True, TAKEN),
    ]


@pytest.mark.parametrize(
    ("kind", "text", "answer", "has"),
    [
        ("geofence", TAKEN, (True, TAKEN), "new"),
        (
            "refused",
            "anna: geofence: no",
            (False, "anna: geofence: no; the old fence applies"),
            "old",
        ),
    ],
)
def test_a_fence_taken_before_the_landing_is_not_reported_as_refused(
    kind: EventKind, text: str, answer: tuple[bool, str], has: str
) -> None:
    async def script(rig: Rig) -> None:
        rig.ask()
        await asyncio.sleep(0.5)
        rig.tell(kind, text)
        rig.tell("fence", "real left the fence")

    rig = run(script)
    assert rig.answers == [answer]
    assert rig.aboard.has == has


def test_a_landing_with_a_guard_that_does_not_answer_leaves_it_unknown() -> None:
    async def script(rig: Rig) -> None:
        rig.ask()
        await asyncio.sleep(0.5)
        rig.tell("abort", "aborted")
        await asyncio.sleep(5.0)

    *_, (ok, text) = run(script).answers
    assert not ok
    assert "landing" in text
    assert NOT_KNOWN in text
