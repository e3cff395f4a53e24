"""`python -m vehicles.mavsdk`: the process that speaks to one vehicle by mavsdk."""

import sys

from vehicles.mavsdk.mavsdk_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
