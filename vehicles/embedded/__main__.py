"""One embedded vehicle as a process: `python -m wil_campaign.vehicles.embedded SETTINGS_JSON`."""

# ruff: noqa: E402 - the collector is off meanwhile: imported objects stay
import gc

gc.disable()  # until the vehicle has opened its link

import sys

from wil_campaign.vehicles.embedded.process.embedded_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
