"""Run a sweep on this machine's processors or on a Dask cluster; finished points are stored.

Points go at once into a log beside the table (``NAME.rows.jsonl``); a sweep that was interrupted
goes on where the log ends. The table is written from the log, in the order of the points, so that
it is the same whoever solved which point.
"""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from drivers import ConfigError
from drivers.core.extras import needs, require
from drivers.core.processes import Workers
from probe.studies.solve import Job, Row, jobs, solve
from probe.studies.vary import Design, Point, parse, places, points
from sim_backend.notebook_line import notebook_line
from sim_backend.scene.scene_file import Scene, as_scene

with needs("data", "palpate sweep"):
    import pandas as pd

Solved = dict[int, list[Row]]

FORMATS = (".parquet", ".csv", ".h5")
LIBRARIES = {".parquet": "pyarrow", ".h5": "h5netcdf"}
OWN = frozenset(("point", "seed", "reason"))
"""Columns by which a table is known to be a sweep's."""
RETRIES = 3
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def sweep(
    scene: Scene | str | Path,
    vary: Mapping[str, str | float | Sequence[float]],
    *,
    out: str | Path = "sweep.parquet",
    design: Design = "full",
    count: int = 0,
    seed: int = 0,
    x_mm: Sequence[float] | float | str = (),
    indentation_mm: float = 2.5,
    model: str = "auto",
    accuracy_pct: float = 1.0,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Press many variants of a scene; a sweep that was interrupted goes on where it stopped.

    Parameters
    ----------
    scene
        A `Scene`, a built-in name or a scene file.
    vary
        Scene keys with their values: ``{"wall_mm": [0.4, 0.6]}``, or as the shell has them,
        ``{"wall_mm": "0.4..0.6:3"}``.
    out
        The table: ``.parquet``, ``.csv`` or ``.h5``. A sweep's own is replaced.
    design
        ``full`` (every combination), ``zip``, or a random ``lhs`` or ``sobol`` of ``count``
        points from intervals ``"0.4..0.6"``.
    count
        Points of a random design.
    seed
        Of a random design.
    x_mm
        Where to press, ``[20, 32]`` or ``"4..60:15"``; over the inclusion if empty.
    indentation_mm
        How deep.
    model
        As of `press`.
    accuracy_pct
        As of `press`.
    workers
        Processes on this machine; by default one for each processor.
    scheduler
        The address of a Dask scheduler that has the workers instead.
    progress
        Given the number of points done and of all; by default a notebook shows them.

    Returns
    -------
    DataFrame
        A row for each point and place. ``reason`` says why a point could not be solved,
        ``error_estimate_pct`` [%] what force and pulse may be off by: more than
        ``accuracy_pct`` where a ``model`` is named that cannot do better.

    Raises
    ------
    ConfigError
        Names the key or value that cannot be, or ``out`` if it is a file of yours.

    Examples
    --------
    >>> import palpate
    >>> table = palpate.sweep(
    ...     "TIHA", {"wall_mm": [0.5, 0.7]}, indentation_mm=1.0, accuracy_pct=5, workers=1
    ... )
    >>> table["inclusion.0.wall_mm"].tolist(), bool((table["force_n"] > 0).all())
    ([0.5, 0.7], True)
    """
    if not isinstance(vary, Mapping):
        raise ConfigError(
            f'vary = {vary!r}: keys with values are needed: {{"wall_mm": [0.4, 0.6]}}'
        )
    loaded = as_scene(scene)
    varied = [
        parse(f"{key}={','.join(str(one) for one in np.ravel(values))}", loaded)
        for key, values in vary.items()
    ]
    with notebook_line() as line:
        return solve_points(
            loaded, points(varied, design, count, seed), Path(out),
            x_mm=places(x_mm) if isinstance(x_mm, str) else tuple(map(float, np.ravel(x_mm))),
            indentation_mm=indentation_mm, model=model, accuracy_pct=accuracy_pct, seed=seed,
            workers=workers, scheduler=scheduler,
            progress=progress or (lambda done, total: line(f"{done} of {total} points")),
        )  # fmt: skip


def solve_points(
    scene: Scene, points: list[Point], out: Path, *, x_mm: tuple[float, ...] = (),
    indentation_mm: float = 2.5, model: str = "auto", accuracy_pct: float = 1.0, seed: int = 0,
    workers: int | None = None, scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> pd.DataFrame:  # fmt: skip
    """Solve all ``points`` and write the table ``out`` (Parquet, CSV or HDF5 by its ending).

    A row per point and place ``x_mm`` (over the inclusion if empty). ``seed`` is what the points
    were drawn with, for the table. ``scheduler`` is the address of a Dask scheduler; else
    ``workers`` processes are used.
    Raises `ConfigError` for an ending, a file that is no sweep's, or a log of another sweep.
    """
    check_out(out)
    settings = [scene.model_dump(mode="json"), points, x_mm, indentation_mm, model, accuracy_pct]
    key = sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]
    log = out.with_suffix(".rows.jsonl")
    done = _read_log(log, key)
    left = [(n, p) for n, p in enumerate(points) if n not in done]
    todo = jobs(scene, left, x_mm, indentation_mm, model, accuracy_pct)
    progress(len(done), len(points))
    if todo:
        out.parent.mkdir(parents=True, exist_ok=True)
        run = _on_cluster(todo, scheduler) if scheduler else _on_this_machine(todo, workers)
        with log.open("a", encoding="utf-8") as file, _saying_what_is_kept(log, done, len(points)):
            if file.tell() == 0:
                file.write(json.dumps({"sweep": key}) + "\n")
            for found in run:
                for point, rows in found.items():
                    file.write(json.dumps({"point": point, "rows": rows}) + "\n")
                    done[point] = rows
                file.flush()
                progress(len(done), len(points))
    table = pd.DataFrame([row for n in sorted(done) for row in done[n]])
    table.insert(1, "seed", seed)
    table.attrs = {"scene": scene.name, "sweep": key}
    write(table, out)
    return table


def check_out(out: Path) -> None:
    """Raises `ConfigError` where no table can be written to ``out``: its ending, or a file is there
    that no sweep has written. A sweep's own table is replaced."""
    if out.suffix not in FORMATS:
        raise ConfigError(f"--out {out}: it must end in {', '.join(FORMATS)}")
    if out.suffix in LIBRARIES:
        require(LIBRARIES[out.suffix], "export", f"a table {out.suffix}")
    if out.exists() and not (out.is_file() and OWN.issubset(_columns(out))):
        raise ConfigError(
            f"--out {out}: exists already and is no table of a sweep; choose another, or move it"
        )


def _columns(table: Path) -> list[str]:
    """The names of its columns; none where it cannot be read."""
    try:
        if table.suffix == ".csv":
            return list(map(str, pd.read_csv(table, nrows=0)))
        if table.suffix == ".parquet":
            from pyarrow import parquet

            with table.open("rb") as file:  # pyarrow takes no name that is not UTF-8
                return list(map(str, parquet.read_schema(file).names))
        import xarray

        with xarray.open_dataset(table, engine="h5netcdf") as held:
            return list(map(str, held.variables))
    except (ValueError, KeyError, OSError):
        return []


@contextmanager
def _saying_what_is_kept(log: Path, done: Solved, points: int) -> Iterator[None]:
    """Within: Ctrl-C says how many of ``points`` the ``log`` keeps."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"{len(done)} of {points} points are kept in {log}; the same command goes on from there"
        ) from None


def _on_this_machine(todo: list[Job], workers: int | None) -> Iterator[Solved]:
    if workers is not None and workers < 0:
        raise ConfigError(f"--workers {workers}: must be 0 (all processors) or more")
    count = min(workers or os.cpu_count() or 1, len(todo))
    if count == 1:
        yield from map(solve, todo)
        return
    for name in THREADS:  # one thread per process: the solves are small
        os.environ.setdefault(name, "1")
    with Workers(count) as pool:
        # As they come, in a queue: a Ctrl-C while `as_completed` holds the locks of all would leave
        # them held, and the pool would wait for them for ever.
        solved: SimpleQueue[Future[Solved]] = SimpleQueue()
        for job in todo:
            pool.submit(solve, job).add_done_callback(solved.put)
        try:
            for _ in todo:
                yield solved.get().result()
        except BrokenProcessPool:
            raise ConfigError(
                "a worker process ended; memory may have run out: sweep with fewer workers"
            ) from None


def _on_cluster(todo: list[Job], scheduler: str) -> Iterator[Solved]:
    distributed: Any
    with needs("cluster", "--scheduler"):
        from dask import distributed
    try:
        client = distributed.Client(scheduler, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(f"--scheduler {scheduler}: no scheduler answers ({error})") from None
    with client:
        futures = client.map(solve, todo, pure=False, retries=RETRIES)
        for _, found in distributed.as_completed(futures, with_results=True):
            yield found


def _read_log(log: Path, key: str) -> Solved:
    if not log.exists():
        return {}
    try:
        lines = log.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise ConfigError(f"{log}: is no log of a sweep (not UTF-8 text); remove it") from None
    done: Solved = {}
    for number, line in enumerate(lines):
        try:
            row = json.loads(line)
        except json.JSONDecodeError:  # the last line of a sweep that was killed
            if number == 0:  # it says whose the rows are
                raise ConfigError(f"{log}: its first line is cut short; remove it") from None
            continue
        whose = row.get("sweep") if isinstance(row, dict) else "none"
        if number == 0 or whose is not None:  # two that began together each wrote their line
            if whose != key:
                raise ConfigError(f"{log} belongs to another sweep: choose another --out, or "
                                  "remove it")  # fmt: skip
            continue
        done[row["point"]] = row["rows"]
    return done


def write(table: pd.DataFrame, out: Path) -> None:
    """Write ``out`` in one piece, in the format of its ending."""
    part = out.with_name(out.name + ".part")
    if out.suffix == ".parquet":
        with part.open("wb") as file:
            mixed = [name for name in table if _is_mixed(table[name])]
            table.astype(dict.fromkeys(mixed, str)).to_parquet(file, index=False)
    elif out.suffix == ".csv":
        table.to_csv(part, index=False)
    else:
        import xarray

        texts = [column for column in table if table[column].dtype == object]
        plain = table.astype(dict.fromkeys(texts, str))
        xarray.Dataset.from_dataframe(plain).to_netcdf(part, engine="h5netcdf")
    part.replace(out)


def _is_mixed(column: "pd.Series[Any]") -> bool:
    """Whether it holds texts beside numbers, which Parquet does not."""
    return len({isinstance(value, str) for value in column.dropna()}) > 1
