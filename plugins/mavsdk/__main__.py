"""`python -m wil_campaign.plugins.mavsdk`: a process that commands one vehicle through mavsdk."""

import sys

from wil_campaign.plugins.mavsdk.mavsdk_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
