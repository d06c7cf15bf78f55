"""Sweeps on a Dask cluster: processes that must answer each other within seconds."""

import json
import os
from pathlib import Path

import pandas as pd
import pytest
from small_sweep import FAST, TIHA, made, without_time

from drivers import ConfigError
from probe.studies.sweep import solve_points

distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")


def test_nobody_at_the_scheduler(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no scheduler answers"):
        solve_points(TIHA, made("wall_mm=0.5"), tmp_path / "t.csv", scheduler="nonsense://x")


@pytest.mark.filterwarnings("ignore")  # what Dask warns of while a worker is killed
def test_a_cluster_gives_the_same_table_though_a_worker_dies(tmp_path: Path) -> None:
    wanted = made("wall_mm=0.4..0.8:12", "systolic_mmhg=120")
    alone = solve_points(TIHA, wanted, tmp_path / "alone.csv", workers=1, **FAST)
    killed: list[int] = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:

        def kill_one(done: int, _total: int) -> None:
            if done >= 3 and not killed:
                killed.append(next(iter(cluster.workers.values())).process.pid)
                os.kill(killed[0], 9)

        there = solve_points(TIHA, wanted, tmp_path / "there.csv", progress=kill_one,
                      scheduler=cluster.scheduler_address, **FAST)  # fmt: skip
    assert killed
    # This process may use more threads than the workers: the last bits of a sum are others then,
    # and a pulse is the small difference of two.
    pd.testing.assert_frame_equal(without_time(alone), without_time(there), rtol=1e-10, atol=0.0)
    lines = (tmp_path / "there.rows.jsonl").read_text().splitlines()[1:]
    assert len({json.loads(line)["point"] for line in lines}) == len(wanted)
