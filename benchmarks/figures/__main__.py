"""Measure the documentation's figures: ``make figures``, or ``make figures ONLY="paper fleet"``.

Without names every figure whose stored result is of another commit is measured, so that a run that
was broken off goes on where it stopped.
"""

import argparse
import json
import sys
import time

from figures.catalogue import FIGURES
from figures.keep import KEPT, Figure, _git, keep


def is_current(figure: Figure) -> bool:
    """Its stored result is of this commit."""
    path = KEPT / f"{figure.name}.json"
    if not path.is_file():
        return False
    stored = json.loads(path.read_text(encoding="utf-8"))
    return stored["commit"] == _git("rev-parse", "--short", "HEAD") and not stored["changed"]


def main() -> int:
    """Measure what was asked for; 0 if all could be."""
    parser = argparse.ArgumentParser(prog="figures", description=__doc__)
    parser.add_argument("only", nargs="*", choices=[*FIGURES, []], help="all without names")
    only = parser.parse_args().only
    for name, figure in FIGURES.items():
        if name not in only if only else is_current(figure):
            continue
        print(f"{name}: about {figure.minutes:g} minutes of a processor …", file=sys.stderr)
        began_s = time.perf_counter()
        path = keep(figure)
        print(f"{path}: {time.perf_counter() - began_s:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
