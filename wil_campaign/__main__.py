"""`python -m wil_campaign`: the command line, for where the console script is not on the path."""

import sys

from wil_campaign.orchestrator.cli import main

sys.exit(main())
