"""What an engine over a cluster costs and survives, with a Ray of this machine.

    python -m bench.cluster overhead --runs 20
    python -m bench.cluster nodes --runs 200
    python -m bench.cluster hosts
    python -m bench.cluster clocks
    python -m bench.cluster faults --seeds 3
    python -m bench.cluster bench

`overhead` flies a campaign of short flights by both engines, and compares results to the byte.
`nodes` does so with a cluster of two nodes on this machine, each with half of the places.
`hosts` flies over two hosts of this machine (network namespaces) by the commands of
docs/cluster.md, and commands what flies; `clocks` does so with an hour between their clocks.
`faults` ends one of the campaign's processes there by SIGKILL at a seeded moment of a flight,
resumes, and counts flights, results and processes that are left. `bench` does so with a campaign on
a bench beside one over both hosts. The last four need root, and the extras cluster and test.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.cluster_bench import BENCH_VICTIMS, account
from bench.cluster_faults import VICTIMS, survives
from bench.cluster_files import contents, write_campaign
from bench.cluster_hosts import ended_in_order
from bench.cluster_hosts_check import compare_clocks, compare_hosts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("what", choices=["overhead", "nodes", "hosts", "clocks", "faults", "bench"])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--folder", default="/var/tmp", help="not beneath /tmp")  # noqa: S108
    parser.add_argument(
        "--kill", choices=[*VICTIMS, *BENCH_VICTIMS], nargs="*", default=list(VICTIMS)
    )
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if given.what == "overhead":
            return overhead(Path(name), given.runs, given.jobs)
        if given.what == "nodes":
            with two_nodes(given.jobs) as address:
                return overhead(Path(name), given.runs, given.jobs, f"ray://{address}")
    # Where hosts have a /tmp of their own, what they share is elsewhere.
    with ended_in_order(), tempfile.TemporaryDirectory(dir=given.folder) as name:
        if given.what == "hosts":
            return compare_hosts(Path(name))
        if given.what == "clocks":
            return compare_clocks(Path(name))
        if given.what == "bench":
            victims = [
                bench_victim for bench_victim in BENCH_VICTIMS if bench_victim in given.kill
            ] or BENCH_VICTIMS
            fine = [
                account(Path(name) / f"{one.replace(' ', '-')}-{seed}", one, seed)
                for seed in range(given.first_seed, given.first_seed + given.seeds)
                for one in victims
            ]
            return 0 if all(fine) else 1
        bad = 0
        for seed in range(given.first_seed, given.first_seed + given.seeds):
            for number, victim in enumerate(given.kill):
                bad += not survives(Path(name) / f"{number}-{seed}", victim, seed)
        return 1 if bad else 0


@contextmanager
def two_nodes(places: int) -> Iterator[str]:
    """Have a cluster of two nodes on this machine, ended at the end; give its address."""
    from ray.cluster_utils import Cluster  # type: ignore[import-not-found]  # noqa: PLC0415  # of an extra

    os.environ.update(RAY_worker_niceness="0")
    halves = [places - places // 2, places // 2]
    cluster = Cluster()
    try:
        for cpus in halves:
            cluster.add_node(
                num_cpus=cpus,
                num_gpus=0,
                node_ip_address="127.0.0.2",
                object_store_memory=80_000_000,
                include_dashboard=False,
            )
        yield cluster.address
    finally:
        cluster.shutdown()


def overhead(folder: Path, runs: int, jobs: int, ray: str = "ray") -> int:
    """Print the time of both engines, per run, and whether their results are the same."""
    campaign = write_campaign(folder, ticks=1)
    took_s: dict[str, float] = {}
    for engine, name in (("local", "local"), ("ray", ray)):
        began_s = time.monotonic()
        subprocess.run(  # noqa: S603 - our own program
            command(campaign, folder / engine, jobs, "--engine", name, "--repetitions", str(runs)),
            check=True,
            stdout=subprocess.DEVNULL,
        )
        flown = flown_folder(folder / engine)
        # From the first order on: without the start of Ray and of the run server.
        first_s = (flown / "campaign.json").stat().st_mtime
        took_s[engine] = (flown / "junit.xml").stat().st_mtime - first_s
        whole_s = time.monotonic() - began_s
        print(f"{engine}: {runs} runs in {took_s[engine]:.2f} s, {whole_s:.2f} s with its start")
    per_run_s = (took_s["ray"] - took_s["local"]) * jobs / runs
    same = contents(flown_folder(folder / "local")) == contents(flown_folder(folder / "ray"))
    ratio = took_s["ray"] / took_s["local"]
    print(
        f"ray adds {per_run_s * 1000:.0f} ms to a run, {ratio:.2f} times the local time; "
        f"results are {'' if same else 'NOT '}equal"
    )
    return 0 if same else 1


def command(campaign: Path, out: Path, jobs: int, *options: str) -> list[str]:
    program = [sys.executable, "-m", "wil_campaign", "run", str(campaign)]
    return [*program, "--out", str(out), "--jobs", str(jobs), *options]


def flown_folder(out: Path) -> Path:
    return next(out.glob("hover/*/campaign.json")).parent


if __name__ == "__main__":
    sys.exit(main())
