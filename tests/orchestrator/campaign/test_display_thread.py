"""What waits for a display that stands still, and what becomes of a display's exceptions."""

import threading
from dataclasses import dataclass, field

import pytest

from wil_campaign.orchestrator.campaign import display_thread
from wil_campaign.orchestrator.campaign.display_thread import DisplayThread
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import RunProgressReport


@dataclass
class Stopped(SilentDisplay):
    """A display that shows nothing until it may."""

    may: threading.Event = field(default_factory=threading.Event)
    shown: list[str] = field(default_factory=list)

    def progress(self, progress: RunProgressReport) -> None:
        assert self.may.wait(60.0)
        self.shown.append(f"{progress.t_s:.0f} s")

    def say(self, text: str) -> None:
        assert self.may.wait(60.0)
        self.shown.append(text)


def test_the_lines_that_wait_for_a_display_are_bounded_and_in_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(display_thread, "_MOST_UPDATES", 2)
    monkeypatch.setattr(display_thread, "_MOST_LINES", 4)
    monkeypatch.setattr(display_thread, "_SETTLED_S", 0.01)
    stopped, taken = Stopped(), threading.Event()

    def finished(_: object) -> None:
        taken.set()
        assert stopped.may.wait(60.0)

    with DisplayThread(stopped) as display:
        monkeypatch.setattr(stopped, "finished", finished)
        display.finished(None)  # type: ignore[arg-type]  # it is only what the thread waits in
        assert taken.wait(60.0)
        for t_s in range(4):
            display.progress(RunProgressReport("large", "wil", 1, "goal", float(t_s)))
        for number in range(4):
            display.say(f"line {number}")
        display.settle()  # does not wait for the display
        assert stopped.shown == []
        stopped.may.set()
        while stopped.shown[-1:] != ["line 1"]:
            display.settle()
        display.say("take off?")
    left_out = "2 lines are left out here: too many waited for the terminal"
    assert stopped.shown == ["0 s", "1 s", "line 0", "line 1", left_out, "take off?"]


class Deaf(SilentDisplay):
    """A display that cannot show messages."""

    def say(self, text: str) -> None:
        raise LookupError(text)


def test_an_error_of_a_display_is_raised_by_a_later_call() -> None:
    with DisplayThread(Deaf()) as display:
        display.say("one")
        with pytest.raises(LookupError, match="one"):
            display.settle()
        display.settle()


def test_a_last_error_of_a_display_is_raised_at_the_end_and_hides_no_other() -> None:
    with pytest.raises(LookupError, match="one"), DisplayThread(Deaf()) as display:
        display.say("one")
    with pytest.raises(OSError, match="disk"), DisplayThread(Deaf()) as display:
        fail_after(display)


def fail_after(display: DisplayThread) -> None:
    display.say("one")
    raise OSError("disk")
