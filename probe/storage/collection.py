"""A folder of runs as a collection: one line of facts for each, cheap enough for hundreds."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from probe.core.errors import RunFileError
from probe.storage.run import open_run


@dataclass(frozen=True)
class Listed:
    """One run file. ``labels``: operator, specimen and notes; ``problem``: why it cannot be read.

    ``finish`` is None for a run that goes on or broke off.
    """

    path: Path
    started_utc: str = ""
    scene: str = ""
    finish: str | None = None
    stations: int = 0
    simulated: bool = False
    labels: Mapping[str, str] = field(default_factory=dict)
    problem: str = ""


def list_runs(folder: Path) -> Iterator[Listed]:
    """Every ``*.run`` below ``folder``, by path. One that cannot be read says why."""
    for path in sorted(folder.rglob("*.run")):
        try:
            yield _facts(path)
        except RunFileError as error:
            yield Listed(path, problem=str(error).removeprefix(f"{path}: "))


def _facts(path: Path) -> Listed:
    run = open_run(path)
    config: Any = run.config
    scene = config.get("scene")
    finish = run.finish
    return Listed(
        path,
        run.started.started_utc,
        scene["name"] if scene else "imported" if config.get("imported") else "",
        None if finish is None else finish.value,
        len((config.get("plan") or {}).get("stations", ())),
        bool(run.simulated),
        config.get("labels") or {},
    )
