"""How long a run waits for its process: from the request to the run server to its first line.

    python -m bench.process_start [--trials 50]

The run server has imported what a run needs, as in a campaign. The mark is 0.15 s.
"""

import argparse
import statistics
import sys
import time
from multiprocessing.connection import Connection

from wil_campaign.orchestrator.campaign.workers.run_server import run_context, start_run_server

MARK_S = 0.15


def begun(connection: Connection) -> None:
    """Say that the process is there, and whether all is imported (in the process)."""
    connection.send("wil_campaign.orchestrator.run.flight.run" in sys.modules)


def start_s() -> float:
    """Return how long one process takes until its first line has run."""
    context = run_context()
    ours, theirs = context.Pipe()
    begin_s = time.perf_counter()
    process = context.Process(target=begun, args=(theirs,))
    process.start()
    imported = ours.recv()
    taken_s = time.perf_counter() - begin_s
    process.join()
    if not imported:
        raise RuntimeError("the run server did not import what a run needs")
    return taken_s


def main() -> int:
    """Print the figures; return whether the median is beyond the mark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=50)
    count = parser.parse_args().trials
    start_run_server()
    begin_s = time.perf_counter()
    start_s()  # waits for the server's imports
    print(f"the run server is there after {time.perf_counter() - begin_s:.2f} s, once a campaign")
    taken_s = sorted(start_s() for _ in range(count))
    median_s, worst_s = statistics.median(taken_s), taken_s[-1]
    print(
        f"process start: {median_s:.4f} s in the median, {worst_s:.4f} s at worst (mark {MARK_S})"
    )
    return int(median_s > MARK_S)


if __name__ == "__main__":
    raise SystemExit(main())
