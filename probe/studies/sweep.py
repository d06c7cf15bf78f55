"""Run a sweep on this machine's processors or on a Dask cluster; what is done stays done.

Points go at once into a log beside the table (``NAME.rows.jsonl``); a sweep that was interrupted
goes on where the log ends. The table is written from the log, in the order of the points, so that
it is the same whoever solved which point.
"""

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from hashlib import sha256
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any

import pandas as pd

from drivers import ConfigError, MissingExtra
from probe.studies.solve import Job, Row, jobs, solve
from probe.studies.vary import Point
from sim_backend.scene import Scene

Solved = dict[int, list[Row]]

FORMATS = (".parquet", ".csv", ".h5")
RETRIES = 3
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def sweep(
    scene: Scene, points: list[Point], out: Path, *, x_mm: tuple[float, ...] = (),
    indentation_mm: float = 2.5, model: str = "auto", accuracy_pct: float = 1.0, seed: int = 0,
    workers: int | None = None, scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> pd.DataFrame:  # fmt: skip
    """Solve all ``points`` and write the table ``out`` (Parquet, CSV or HDF5 by its ending).

    A row per point and place ``x_mm`` (over the inclusion if empty). ``seed`` is what the points
    were drawn with, for the table. ``scheduler`` is the address of a Dask scheduler; else
    ``workers`` processes are used.
    Raises `ConfigError` for an ending, or for a log of another sweep.
    """
    if out.suffix not in FORMATS:
        raise ConfigError(f"--out {out}: it must end in {', '.join(FORMATS)}")
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
        with log.open("a", encoding="utf-8") as file:
            if file.tell() == 0:
                file.write(json.dumps({"sweep": key}) + "\n")
            for found in run:
                for point, rows in found.items():
                    done[point] = rows
                    file.write(json.dumps({"point": point, "rows": rows}) + "\n")
                file.flush()
                progress(len(done), len(points))
    table = pd.DataFrame([row for n in sorted(done) for row in done[n]])
    table.insert(1, "seed", seed)
    table.attrs = {"scene": scene.name, "sweep": key}
    write(table, out)
    return table


def _on_this_machine(todo: list[Job], workers: int | None) -> Iterator[Solved]:
    count = min(workers or os.cpu_count() or 1, len(todo))
    for name in THREADS:  # one thread per process: the solves are small
        os.environ.setdefault(name, "1")
    with ProcessPoolExecutor(
        count, mp_context=get_context("spawn"), initializer=_leave_with_parent
    ) as pool:
        futures = [pool.submit(solve, job) for job in todo]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _leave_with_parent() -> None:
    """End this worker when the sweep is killed: a pool's workers would wait for ever."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def _on_cluster(todo: list[Job], scheduler: str) -> Iterator[Solved]:
    distributed: Any
    try:
        from dask import distributed
    except ImportError:
        raise MissingExtra('--scheduler needs Dask: pip install "palpate[cluster]"') from None
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
    lines = log.read_text(encoding="utf-8").splitlines()
    done: Solved = {}
    for number, line in enumerate(lines):
        try:
            row = json.loads(line)
        except json.JSONDecodeError:  # the last line of a sweep that was killed
            continue
        if number == 0:
            if row.get("sweep") != key:
                raise ConfigError(f"{log} belongs to another sweep: choose another --out, or "
                                  "remove it")  # fmt: skip
            continue
        done[row["point"]] = row["rows"]
    return done


def write(table: pd.DataFrame, out: Path) -> None:
    """Write ``out`` in one piece, in the format of its ending."""
    part = out.with_name(out.name + ".part")
    if out.suffix == ".parquet":
        table.to_parquet(part, index=False)
    elif out.suffix == ".csv":
        table.to_csv(part, index=False)
    else:
        import xarray

        texts = [column for column in table if table[column].dtype == object]
        plain = table.astype(dict.fromkeys(texts, str))
        xarray.Dataset.from_dataframe(plain).to_netcdf(part, engine="h5netcdf")
    part.replace(out)
