"""A fleet file: random phantoms of every kind, scanned, to train and to test detectors on.

One Latin hypercube per kind, each from its own seed; every row is one press of one scan. What was
drawn stands beside what is measured, so the file is its own ground truth.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from drivers.core.arrays import Array
from drivers.core.extras import needs
from probe.studies.sweep import check_out, solve_points, write
from probe.studies.vary import Point, parse, points
from sim_backend.scene.scene_file import load_scene

with needs("data", "palpate fleet"):
    import pandas as pd


STATIONS_MM = tuple(4.0 * n for n in range(1, 16))
KINDS = {"nothing": "TI", "tumour": "TIT", "artery": "TIHA", "stenotic artery": "TISA"}
BLOCK = (
    "tissue.height_mm=14..25", "tissue.modulus_kpa=10..100:log", "indenter.radius_mm=3..8",
    "indentation_mm=1..2.5",
)  # fmt: skip
PLACE = ("inclusion.0.x_mm=20..44", "inclusion.0.depth_mm=6..10")
LUMP = ("diameter_mm=3..8", "inclusion.0.modulus_kpa=150..3000:log")
VESSEL = (
    "inner_diameter_mm=2..5", "wall_mm=0.3..0.9", "inclusion.0.modulus_kpa=200..1000:log",
    "diastolic_mmhg=60..95", "systolic_mmhg=100..160",
)  # fmt: skip
PLAQUE = ("stenosis.fraction=0.2..0.6", "stenosis.modulus_kpa=1000..8000:log")
VARIED = {
    "nothing": BLOCK,
    "tumour": (*BLOCK, *PLACE, *LUMP),
    "artery": (*BLOCK, *PLACE, *VESSEL),
    "stenotic artery": (*BLOCK, *PLACE, *VESSEL, *PLAQUE),
}
"""What is drawn, in the words of ``palpate sweep --vary``; every combination is a possible body."""


def drawn(kind: str, count: int, seed: int) -> list[Point]:
    """``count`` random phantoms of a kind."""
    scene = load_scene(KINDS[kind])
    varied = [parse(text, scene) for text in VARIED[kind]]
    return points(varied, "lhs", count, seed + list(KINDS).index(kind))


def fleet(
    count: int, out: Path, *, seed: int = 0, x_mm: tuple[float, ...] = STATIONS_MM,
    workers: int | None = None, scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> pd.DataFrame:  # fmt: skip
    """Scan ``count`` phantoms of each kind, a station per place, and write the table ``out``.

    Columns are those of a sweep after ``kind``, and ``half_pulse_n`` for `force_n`. Each kind is a
    sweep of its own beside ``out``; an interrupted fleet goes on where it stopped.
    """
    parts = {
        kind: out.with_name(f"{out.stem}-{kind.replace(' ', '-')}{out.suffix}") for kind in KINDS
    }
    for one in (out, *parts.values()):
        check_out(one)
    tables = []
    for n, (kind, scene) in enumerate(KINDS.items()):

        def report(done: int, _all: int, before: int = n * count) -> None:
            progress(before + done, len(KINDS) * count)

        table = solve_points(
            load_scene(scene), drawn(kind, count, seed), parts[kind], x_mm=x_mm, model="quick",
            seed=seed + n, workers=workers, scheduler=scheduler, progress=report,
        )  # fmt: skip
        table.insert(0, "kind", kind)
        tables.append(table)
    whole = pd.concat(tables, ignore_index=True)
    write(whole, out)
    return whole


def force_n(rows: pd.DataFrame, share: Array) -> Array:
    """Force (n, t) [N] of a fleet's ``rows`` (n) while the pressure is at ``share`` (t,) of the way
    from diastole to systole: the parabola through both and their mean."""
    low, pulse, half = (rows[name].to_numpy(float)[:, None]
                        for name in ("force_n", "pulse_n", "half_pulse_n"))  # fmt: skip
    s = np.asarray(share, dtype=float)
    return np.asarray(low + pulse * s + 4 * (half - pulse / 2) * s * (1 - s))
