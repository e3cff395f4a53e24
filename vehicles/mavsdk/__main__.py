"""`python -m vehicles.mavsdk`: the process that commands one vehicle through mavsdk."""

import sys

from vehicles.mavsdk.mavsdk_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
