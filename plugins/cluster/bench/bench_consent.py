"""Consent to arm the vehicle of a bench, given at its terminal for a campaign of the cluster."""

import sys
import termios

from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.orchestrator.cli.arming_consent import (
    RefusedError,
    ask_to_arm,
    find_vehicles,
    require_may_arm,
    user_name,
)
from wil_campaign.orchestrator.cli.standard_streams import err
from wil_campaign.plugins.cluster.node_messages import ConsentAnswer, ConsentAsked
from wil_campaign.worlds.files.problems import printable


def consent_at_bench(bench: Bench, request: ConsentAsked) -> ConsentAnswer:
    """Return this bench's answer to a campaign of the cluster, given by the person at its terminal.

    The vehicle is identified first. Input that was typed before the question is discarded.
    """
    what = printable(f"campaign '{request.campaign}' of {request.place}")
    try:
        if request.arm:
            require_may_arm((bench,), user_name())
        found = find_vehicles((bench.vehicle,))
        if request.arm:
            termios.tcflush(sys.stdin, termios.TCIFLUSH)
            ask_to_arm(what, request.runs, found)
    except RefusedError as error:
        err(f"{what}: {error}")
        return ConsentAnswer(f"bench {bench.name}: {error}", error.code)
    is_hardware = not all(one.identity.simulation for one in found)
    return ConsentAnswer(
        code=0,
        real_kind="hardware" if is_hardware else "sitl",
        hardware=bench.vehicle.name if is_hardware else "",
        vehicle=" and ".join(map(str, found)),
    )
