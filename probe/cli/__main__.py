"""``python -m probe.cli`` is ``palpate``."""

import sys

from probe.cli import command

sys.exit(command())
