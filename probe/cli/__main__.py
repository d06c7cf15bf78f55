"""``python -m probe.cli`` is ``palpate``."""

import sys

from probe.cli import main

sys.exit(main())
