"""How near the embedded vehicles fly to their firmwares: one flight of steps, 22 figures each.

`python bench/fidelity.py [px4|ardupilot] [--profile NAME]`; virtual time. Flight and figures are
those with which the firmwares were measured: the least and the most of each figure over four
flights lie in plugins/step_response, a 50 Hz series of one in tests/vehicles/embedded/fidelity. A
figure is off by its distance from the firmware's range relative to the nearer end; an overshoot by
its distance over 0.15 m or 5 degrees. Beside it, the RMS distance between the series of each
segment, counted from the segment's start, and the orders of events; for PX4 the median of the
distances from ten flights of the firmware, and what that is for each of them (median, most).
"""

import argparse
import sys
import time
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.vehicles.embedded.fidelity.comparison import (
    distances,
    load_flights,
    load_series,
    median_distances,
    scatter,
)
from tests.vehicles.embedded.fidelity.step_flight import fly_steps
from wil_campaign.plugins.step_response.comparison import compare_figures, load_ranges
from wil_campaign.plugins.step_response.figures import figures_of


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("autopilot", nargs="*", default=["px4", "ardupilot"])
    parser.add_argument("--profile", default=None)
    arguments = parser.parse_args()
    for autopilot in arguments.autopilot:
        began_s = time.process_time()
        flown, orders = fly_steps(autopilot, arguments.profile)
        cpu_s = time.process_time() - began_s
        rows = compare_figures(load_ranges(autopilot), figures_of(flown))
        for row in rows:
            least, most = row.firmware
            mark = "  <--" if row.beyond else ""
            print(
                f"{autopilot:9s} {row.segment:12s} {row.name:14s} firmware {least:>6} to {most:<6} "
                f"embedded {row.flown!s:>6} off {row.off:+.0%}{mark}"
            )
        for segment, metres in distances(load_series(autopilot), flown).items():
            print(f"{autopilot:9s} {segment:13s} RMS {metres:.3f} m")
        if autopilot == "px4":
            flights = load_flights()
            own = scatter(flights)
            for segment, metres in median_distances(flights, flown).items():
                least, most = median(own[segment]), max(own[segment])
                print(
                    f"{autopilot:9s} {segment:13s} of ten flights {metres:.3f} m, "
                    f"they of each other {least:.3f} m, at most {most:.3f} m"
                )
        for order in orders:
            mark = f"  <-- firmware {order.firmware}" if order.beyond else ""
            print(f"{autopilot:9s} {order.name:13s} {' > '.join(order.flown)}{mark}")
        beyond = sum(row.beyond for row in rows)
        print(f"{autopilot}: {beyond} of {len(rows)} figures beyond 15 %, {cpu_s:.1f} s of CPU")


if __name__ == "__main__":
    main()
