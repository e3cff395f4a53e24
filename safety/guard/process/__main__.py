"""`python -m safety.guard.process CHANNEL LIFELINE HOLD [scaled]`: a guard's process."""

import sys

from safety.guard.process.guard_process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
