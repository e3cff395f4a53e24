"""`wil-campaign bench`: check bench files, and serve a bench to a cluster.

Consent to arm the vehicle of a bench, given at its terminal for a campaign of the cluster.
"""

import tempfile
import threading
from multiprocessing.connection import Listener
from pathlib import Path

from wil_campaign.campaigns.setup.bench_file import Bench, load_benches
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_benches, held_links
from wil_campaign.orchestrator.campaign.folder.campaign_folder import FolderTakenError, OutputError
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.cli.arming_consent import (
    FlightRefusedError,
    ask_to_arm,
    find_vehicles_to_arm,
    has_terminal,
    require_may_arm,
    user_name,
)
from wil_campaign.orchestrator.cli.commands.validate import bench_summary
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.plugins.cluster.bench.bench_node import bench_node
from wil_campaign.plugins.cluster.bench.bench_server import BenchServer
from wil_campaign.plugins.cluster.node_messages import ConsentAnswer, ConsentAsked
from wil_campaign.plugins.cluster.ray_engine import engine_address
from wil_campaign.safety.guard.process.runtime_folder import open_runtime_folder


def consent_at_bench(bench: Bench, request: ConsentAsked) -> ConsentAnswer:
    """Return this bench's answer to a campaign of the cluster, given by the person at its terminal.

    The vehicle is identified first. Input that was typed before the question is discarded.
    """
    what = printable_problem(f"campaign '{request.campaign}' of {request.place}")
    try:
        if request.arm:
            require_may_arm((bench,), user_name())
        found = find_vehicles_to_arm((bench.vehicle,))
        if request.arm:
            ask_to_arm(what, request.runs, found)
    except FlightRefusedError as error:
        write_stderr(f"{what}: {error}")
        return ConsentAnswer(f"bench {bench.name}: {error}", error.code)
    is_hardware = not all(vehicle.identity.simulation for vehicle in found)
    return ConsentAnswer(
        code=0,
        real_kind="hardware" if is_hardware else "sitl",
        hardware=bench.vehicle.name if is_hardware else "",
        vehicle=" and ".join(map(str, found)),
    )


def check(*files: Path) -> int:
    """Report every fault of bench files, and equal names; nothing is connected to.

    Parameters
    ----------
    files
        Bench files.
    """
    if not files:
        write_stderr("bench check needs at least one file")
        return 2
    for bench in load_benches(files):
        write_stdout(f"{bench.document.name}: {bench_summary(bench)}")
    return 0


def serve(file: Path, *, engine: str) -> int:
    """Join a cluster, and fly its campaigns on a bench of this machine; Ctrl-C lands and ends it.

    Each campaign needs consent on this terminal, after the vehicle was identified. Guard,
    operator socket and `wil-campaign abort` are those of this machine.

    Parameters
    ----------
    file
        The bench file.
    engine
        The cluster: ray://HOST:PORT.
    """
    (bench,) = load_benches((file,))
    if not has_terminal():
        write_stderr(
            "bench serve needs a terminal: consent to arm is given there, by a person at the bench"
        )
        return 2
    try:
        address = engine_address(engine)
        if address is None:
            write_stderr(
                "--engine ray: a bench joins a running cluster; give --engine ray://HOST:PORT"
            )
            return 2
        with held_benches((bench,)), held_links(bench.vehicle.addresses):
            return _serve_bench(bench, address)
    except (FolderTakenError, OutputError) as error:
        write_stderr(error)
        return 3
    except EngineError as error:
        write_stderr(error)
        return error.code
    except KeyboardInterrupt:
        return 0  # vehicles that flew have landed


def _serve_bench(bench: Bench, address: str) -> int:
    """Serve a bench until its node of the cluster has ended. Raises EngineError."""
    server = BenchServer(
        bench, consent=lambda request: consent_at_bench(bench, request), say=write_stderr
    )
    with tempfile.TemporaryDirectory(prefix="bench-", dir=open_runtime_folder().path) as folder:
        socket = Path(folder) / "server"
        with (
            Listener(str(socket), family="AF_UNIX") as listener,
            bench_node(address, bench.facts, socket) as node,
        ):

            def stop_with_node() -> None:
                node.wait()
                server.stop(str(socket))

            threading.Thread(target=stop_with_node, daemon=True).start()
            write_stderr(f"{bench_summary(bench)}, serves {address}; Ctrl-C ends it")
            server.serve(listener)
    write_stderr(
        f"bench {bench.name}: the connection to {address} is lost; start `bench serve` again"
    )
    return 3
