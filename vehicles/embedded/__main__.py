"""`python -m vehicles.embedded SETTINGS_JSON`: one embedded vehicle in a process of its own."""

import sys

from vehicles.embedded.process.embedded_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
