"""Figures of whole scans of the phantom."""

import tempfile
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

from probe.cli import main

SCENES = ("TI", "TIT", "TIHA", "TISA")


def demo() -> dict[str, Any]:
    """What `palpate scan --scene TIHA --seed 1` prints, and what it finds in each scene."""
    found, printed = {}, ""
    for scene in SCENES:
        with tempfile.TemporaryDirectory() as out, redirect_stdout(StringIO()) as said:
            status = main(["scan", "--scene", scene, "--seed", "1", "--out", out])
        if status:
            raise RuntimeError(f"palpate scan --scene {scene}: exit {status}")
        lines = [line for line in said.getvalue().splitlines() if out not in line]
        found[scene] = lines
        printed = "\n".join(lines) if scene == "TIHA" else printed
    return {"printed": printed, "scenes": found}
