"""One command over several runs: one that cannot be read stops no other."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from probe.cli.errors import BAD_INPUT, status_of
from probe.cli.say import answer_json, inform

Work = Callable[[Path], Mapping[str, Any]]


def of_each(
    runs: Sequence[Path], work: Work, *, json: bool, together: str = ""
) -> tuple[list[dict[str, Any]], int]:
    """What ``work`` made of each run, ``run`` and ``error`` where it cannot be read, and the
    exit status. A single run's error is raised, and so is any error that lies with no run.

    With ``json`` it is printed: of one run alone, else as a list under ``together``, ``runs`` if
    there are several.
    """
    from probe.cli.progress import counting  # here: --help needs no numpy

    found: list[dict[str, Any]] = []
    worst = 0
    several = counting("runs") if len(runs) > 1 else nullcontext(lambda _done, _total: None)
    with several as progress:
        for run in runs:
            progress(len(found), len(runs))
            try:
                found.append(dict(work(run)))
            except Exception as error:
                status, text = status_of(error)
                if len(runs) == 1 or status != BAD_INPUT:
                    raise
                worst = status
                inform(text)
                found.append({"run": run, "error": text})
        progress(len(found), len(runs))
    if json:
        together = together or ("runs" if len(runs) > 1 else "")
        answer_json({together: found} if together else found[0])
    return found, worst
