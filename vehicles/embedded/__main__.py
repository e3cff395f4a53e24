"""`python -m vehicles.embedded SETTINGS_JSON`: runs one embedded vehicle as a process."""

# ruff: noqa: E402 - the collector is off meanwhile: imported objects stay
import gc

gc.disable()  # until the vehicle has opened its link

import sys

from vehicles.embedded.process.embedded_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
