"""What a signed command by MQTT costs, apart from the broker.

    python -m bench.signing [--commands N]

Signs and checks commands and prints the microseconds of each, as a median. The mark is 100 us.
"""

import argparse
import json
import statistics
import time

from wil_campaign.plugins.mqtt.message_signing import signed_message, verified_message

TOPIC = "wil/gate/operator/abort"
KEY = b"of the bench"
BODY = {"session": "20261121T153936Z", "id": "a1", "at": 1_763_739_600.0, "who": "anna"}
MARK_US = 100.0


def main() -> int:
    """Print the figures; return whether they are beyond the mark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--commands", type=int, default=5000)
    count = parser.parse_args().commands
    body, taken_us = json.dumps(BODY).encode(), []
    for _ in range(count):
        begin_ns = time.perf_counter_ns()
        verified_message(TOPIC, signed_message(TOPIC, body, KEY), KEY)
        taken_us.append((time.perf_counter_ns() - begin_ns) / 1e3)
    median_us = statistics.median(taken_us)
    print(f"signed and checked: {median_us:.1f} us in the median of {count} (mark {MARK_US:g})")
    return int(median_us > MARK_US)


if __name__ == "__main__":
    raise SystemExit(main())
