"""Points of a sweep over TIHA that are solved in a moment."""

import pandas as pd

from probe.studies.vary import parse, points
from sim_backend import load_scene

TIHA = load_scene("TIHA")
FAST = {"model": "small", "accuracy_pct": 20.0, "indentation_mm": 1.0}


def made(*texts: str) -> list[dict[str, float | str]]:
    """The points of ``--vary`` options."""
    return points([parse(text, TIHA) for text in texts], "full", 0, 0)


def without_time(table: pd.DataFrame) -> pd.DataFrame:
    """A sweep's table without what differs from run to run."""
    return table.drop(columns="seconds").reset_index(drop=True)
