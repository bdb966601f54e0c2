"""``python -m dense_vs``."""

import sys

from dense_vs.cli import main

sys.exit(main())
