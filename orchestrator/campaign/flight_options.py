"""How a campaign is flown: the options of a person or a program, and what they come to."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.hooks import engines
from wil_campaign.installed_plugins import plugin_additions
from wil_campaign.orchestrator.campaign.workers.run_engine import LOCAL, LocalRunEngine, RunEngine
from wil_campaign.orchestrator.run_results.campaign_results import VehicleKind


def _engine_help() -> str:
    """Return the help of --engine, with the engines of plugins."""
    here = "Where runs fly: local, in processes of this machine"
    return "; ".join(
        (here, *(engine.help for engine in plugin_additions(engines).values() if engine.help))
    )


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOptions:
    """How a campaign is flown: the options of `wil-campaign run`, and of `wil_campaign.run`.

    Parameters
    ----------
    out
        The folder for the results: DIR/<campaign>/<UTC start>/.
    clock
        virtual: as fast as the machine can, with results that are the same to the byte each time.
        wall: in real time, each vehicle in its own process on UDP. scaled: at the requested pace of
        the simulations, as far as they reach it. By default virtual; wall where the campaign has
        something external, such as an attached vehicle, a live camera, a simulator, a program or an
        outgoing stream; scaled where a simulation is launched at its own pace.
    jobs
        How many runs fly at once, each in its own process; by default one per core, on the wall
        clock one per two cores.
    store
        A URL that every node of a cluster reaches, through which results come into --out:
        file:///FOLDER that all share, or s3://BUCKET/PREFIX, which needs the extra storage.
    arm_real
        Allow arming attached vehicles of the pair, which may be hardware.
    arm_actors
        Allow arming attached actors, which may be hardware and fly beside the pair.
    resume
        Resume an interrupted campaign: the newest beneath --out, or --out itself where that is a
        campaign's folder. Finished runs are kept, missing ones are flown; refused when the campaign
        or one of its files has changed. Give the same options as before.
    again
        With --resume: fly this run (case/mode/repetition) again, which proved nothing or was lost;
        may be given several times. Runs with a real vehicle are flown again only by this option.
    junit
        Write junit.xml here as well; the folder must exist.
    arm
        False: try each case and mode once, up to arming.
    runs
        Only these runs (case/mode/repetition); None: all.
    """

    out: Path = Path("results")
    clock: Clock | None = None
    jobs: int | None = None
    engine: Annotated[str, Parameter(help=_engine_help())] = LOCAL
    store: str = ""
    arm_real: Annotated[bool, Parameter(negative=())] = False
    arm_actors: Annotated[bool, Parameter(negative=())] = False
    resume: Annotated[bool, Parameter(negative=())] = False
    again: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    junit: Path | None = None
    arm: Annotated[bool, Parameter(parse=False)] = True
    runs: Annotated[tuple[str, ...] | None, Parameter(parse=False)] = None


USUAL = FlightOptions()


@dataclass(frozen=True, slots=True)
class ClearedCampaign:
    """A campaign cleared for flight: what its options came to.

    jobs: how many runs fly at once. real_kind: what flies as the real vehicle. hardware: the names
    of the vehicles that are not simulations, which a person has to move between runs; empty for
    none. engine: where runs fly. settings: KEY=VALUE for the campaign, of what its attached
    vehicles offer and its file leaves open. uids: see RunOrder.
    """

    clock: Clock
    jobs: int
    real_kind: VehicleKind = "embedded"
    hardware: str = ""
    engine: RunEngine = field(default_factory=LocalRunEngine)
    settings: tuple[str, ...] = ()
    uids: Mapping[str, str] = field(default_factory=dict)
