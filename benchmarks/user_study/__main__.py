"""Entry point of `python -m benchmarks.user_study`."""

import sys

from benchmarks.user_study.make import main

sys.exit(main())
