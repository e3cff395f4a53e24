"""Outages of links: a run in which one never began shows nothing about it."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.plugins.impaired_links.impairment import Impairment, LinkOutage
from wil_campaign.plugins.impaired_links.link_outages import LinkOutages
from wil_campaign.plugins.impaired_links.link_setups import ImpairedLinks, LinkSetup, StageOutage
from wil_campaign.safety.guard.core.commands import StartOutage

WITHIN = StageOutage(stage="goal", after_s=2.0, for_s=3.0)
BEYOND = StageOutage(stage="goal", after_s=20.0, for_s=3.0)


@pytest.mark.parametrize(
    ("link", "flown", "reason"),
    [
        (LinkSetup(outages=(WITHIN,)), "real", None),
        (LinkSetup(outages=(BEYOND,)), "twin", None),
        (LinkSetup(outages=(WITHIN, BEYOND)), "real", "real 20 s after stage goal"),
        (LinkSetup(outgoing=Impairment(outages=(LinkOutage(3.0, 1.0),))), "real", None),
        (
            LinkSetup(outgoing=Impairment(outages=(LinkOutage(60.0, 1.0),))),
            "real",
            "real 60 s after its opening",
        ),
    ],
)
def test_a_run_whose_outage_never_began_is_invalid(
    link: LinkSetup, flown: str, reason: str | None
) -> None:
    sent: list[Any] = []

    async def fly() -> list[tuple[str, str]]:
        run_state = RunState(time=asyncio.get_running_loop().time)
        outages = LinkOutages(ImpairedLinks({"real": link}))
        context: Any = SimpleNamespace(name=flown)
        guard: Any = SimpleNamespace(send=sent.append)
        outages.attach([context])
        outages.attach_guard(guard)
        assert not list(outages.tasks(run_state))
        run_state.enter("goal")
        await asyncio.sleep(10.0)
        run_state.enter("end")
        return [(event.kind, event.text) for event in run_state.decisive]

    text = f"a blackout never began: that of the link to {reason}"
    assert run_virtual(fly()) == ([] if reason is None else [("INVALID", text)])
    begun = WITHIN in link.outages and flown == "real"
    assert sent == ([StartOutage("real", 3.0)] if begun else [])
