"""`python -m vehicles.embedded SETTINGS_JSON`: runs one embedded vehicle as a process."""

import sys

from vehicles.embedded.process.embedded_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
