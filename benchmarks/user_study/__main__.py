"""Entry point of `python -m benchmarks.user_study`."""

import sys

from benchmarks.user_study.make import main

if __name__ == "__main__":
    sys.exit(main())
