"""`links:` of a campaign: what it means, and what is wrong with it."""

from collections.abc import Mapping
from typing import Any

import pytest

from wil_campaign.plugins.impaired_links.impaired import Radio
from wil_campaign.plugins.impaired_links.impairment import Impairment, LinkOutage
from wil_campaign.plugins.impaired_links.link_setups import ImpairedLinks, LinkSetup


def links_of(files: Any) -> Mapping[str, LinkSetup]:
    """Return the impaired links of the first case."""
    setup = next(iter(files.load().setups.values())).observers["links"]
    assert isinstance(setup, ImpairedLinks)
    return setup.links


def test_only_a_link_that_is_impaired_or_goes_dark_has_a_radio(files: Any) -> None:
    files.append("links: {real: {}, twin: {blackouts: [{on: goal, for_s: 3}]}}\n")
    setup = next(iter(files.load().setups.values())).observers["links"]
    assert setup.link_layer("real", (7,)) is None
    assert setup.link_layer("intruder", (7,)) is None
    flawless = Radio(outgoing=Impairment(), incoming=Impairment(), seed=(7,))
    assert setup.link_layer("twin", (7,)) == flawless


def test_a_link_is_bad_both_ways_unless_one_is_named(files: Any) -> None:
    files.append(
        "links:\n"
        "  real: {latency_ms: 80, jitter_ms: 40, loss: 0.05, bandwidth_kbit_s: 57.6,\n"
        "         to_vehicle: {loss: 0.5}, blackouts: [{from_s: 60, for_s: 3}]}\n"
    )
    (real,) = links_of(files).values()
    dark = (LinkOutage(60, 3),)
    assert real.outgoing == Impairment(loss=0.5, outages=dark)
    assert real.incoming == Impairment(
        latency_s=0.08, jitter_s=0.04, loss=0.05, bandwidth_bit_s=57_600.0, outages=dark
    )


def test_an_outage_may_wait_for_a_stage(files: Any) -> None:
    files.append("links: {twin: {blackouts: [{on: goal, after_s: 2, for_s: 3}]}}\n")
    twin = links_of(files)["twin"]
    (blackout,) = twin.outages
    assert (blackout.stage, blackout.after_s, blackout.for_s) == ("goal", 2.0, 3.0)
    assert twin.outgoing == Impairment()


@pytest.mark.parametrize(
    ("link", "said"),
    [
        ("{loss: 5}", "must be at most 1, is 5"),
        ("{latency_s: 0.08}", "unknown key 'latency_s'"),
        ("{jitter_ms: 40}", "is more than the latency of 0 ms"),
        ("{bursts: {length_s: 0.3}}", "missing key 'gap_s'"),
        ("{blackouts: [{for_s: 3}]}", "give from_s, or the stage `on`"),
        ("{blackouts: [{from_s: 1, on: goal, for_s: 3}]}", "give from_s, or the stage `on`"),
        ("{blackouts: [{from_s: 1, after_s: 2, for_s: 3}]}", "counts from a stage"),
        ("{blackouts: [{on: flight, for_s: 3}]}", "must be takeoff, at_height, goal, done or land"),
        ("{bandwidth_kbit_s: 0}", "must be greater than 0"),
        ("{loss: 0.5, to_vehicle: {}, from_vehicle: {}}", "to_vehicle and from_vehicle replace"),
    ],
)
def test_a_wrong_link_condition_is_reported_at_its_place(files: Any, link: str, said: str) -> None:
    files.append(f"links: {{real: {link}}}\n")
    faults = files.faults()
    assert len(faults) == 1
    assert said in faults[0]
    assert faults[0].startswith("campaign.yaml:")
