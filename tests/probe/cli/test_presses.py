"""`press` and `sweep`: what they say of how good their answers are, and what they refuse."""

from pathlib import Path
from typing import Any


def test_a_sweep_says_how_many_rows_miss_the_accuracy_and_what_to_do(
    palpate: Any, tmp_path: Path
) -> None:
    """Small strain misses 5 % of a pulse by far; the model that is taken unasked meets it."""
    asked = ("sweep", "TIHA", "--vary", "wall_mm=0.5", "--depth", "0.5", "--accuracy", "5",
             "--workers", "1", "--json", "--out")  # fmt: skip
    small = palpate(*asked, tmp_path / "small.csv", "--model", "small")
    assert small.status == 0
    assert small.json["too_rough"] == 1
    assert small.json["largest_error_estimate_pct"] > 5
    assert "1 of 1 rows miss the accuracy of 5 % that was asked for" in small.err
    assert "leave --model out" in small.err
    chosen = palpate(*asked, tmp_path / "chosen.csv")
    assert chosen.json["too_rough"] == 0
    assert chosen.json["largest_error_estimate_pct"] <= 5
    assert "miss" not in chosen.err
