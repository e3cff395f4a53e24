"""A guard: `python -m wil_campaign.safety.guard.process CHANNEL LIFELINE HOLD [scaled]`."""

import sys

from wil_campaign.safety.guard.process.guard_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
