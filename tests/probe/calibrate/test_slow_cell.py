"""``calibrate latency`` offers the ``filter_s`` of a cell that has a low pass of its own."""

from itertools import zip_longest
from pathlib import Path

import pytest
from slow_cells import taps

from probe.cli import main


@pytest.mark.parametrize(
    ("filter_s", "status", "said"),
    [(0.1, 0, "say filter_s = 0.1 in its [[sensor]]"), (0.5, 2, "say filter_s = 0.5 in its"),
     (0.0, 0, "")],
)  # fmt: skip
def test_a_slow_cell_is_offered_its_key_also_where_its_delay_is_ambiguous(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], filter_s: float, status: int, said: str
) -> None:
    stage_s, depth_mm, sensor_s, force_n = taps(filter_s, 0.01, 100.0, 5e-3, 1)
    stage, sensor = zip(stage_s, depth_mm, strict=True), zip(sensor_s, force_n, strict=True)
    rows = zip_longest(stage, sensor, fillvalue=("", ""))
    table = tmp_path / "taps.csv"
    table.write_text(
        "time_s,depth_mm,sensor_time_s,force_n\n"
        + "".join(f"{a},{b},{c},{d}\n" for (a, b), (c, d) in rows)
    )
    out = str(tmp_path / "latency.json")
    assert main(["calibrate", "latency", str(table), "--device", "cell", "--out", out]) == status
    heard = capsys.readouterr().err
    assert said in heard
    assert ("filter_s" in heard) == bool(said)
