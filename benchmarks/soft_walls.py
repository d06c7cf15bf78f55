"""Walls that nearly burst: how far a pulse is from `press`, over what is stated of it.

    python benchmarks/soft_walls.py [CASES]

TIHA with a wall of 50 to 400 kPa, 0.3 to 0.8 mm thick, 6 to 12.6 mm deep, in tissue of 10 to 63
kPa, at a systole of 110 to 180 mmHg, 0.5 to 3 mm deep, beside or over the vessel. ``model``: a
scan's force model at half its depth. ``quick``: a sweep's quick scan at its own. Each ``as it is``,
and ``without`` what it solves more where a pulse bends `MUCH`, whose values follow from this. Goes
on where docs/results/soft-walls.csv ends. Draws docs/pictures/soft-walls.png.
"""

import math
import sys
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from kept import ROOT, Row, fill
from matplotlib.figure import Figure

from probe.report.look import BLUE, VERMILLION
from sim_backend.fem.newton import CannotSolve
from sim_backend.models import plane_response, scan_estimate
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.waves import PA_PER_MMHG

OUT = ROOT / "docs" / "results" / "soft-walls.csv"
PICTURE = ROOT / "docs" / "pictures" / "soft-walls.png"
WAYS: dict[str, Any] = {"model": plane_response, "quick": scan_estimate}
TITLES = {"model": "force model of a scan", "quick": "quick scan of a sweep"}
SOLVED = ("as it is", WITHOUT := "without")
MIDDLE_M, ACCURACY_PCT = 0.032, 0.3
TICKS = (0.05, 0.1, 0.2, 0.5, 1.0)


class Drawn(NamedTuple):
    """A scene, where it is pressed and how deep."""

    scene: Scene
    x_m: float
    depth_m: float

    @property
    def wave_pa(self) -> tuple[float, float]:
        pulse = self.scene.pulse
        return PA_PER_MMHG * pulse.diastolic_mmhg, PA_PER_MMHG * pulse.systolic_mmhg


class Pulse(NamedTuple):
    """A pulse, what is stated of its error [N], and how much it bends."""

    size_n: float
    error_n: float
    bend: float


def drawn(case: int) -> Drawn:
    """Number ``case``."""
    rng = np.random.default_rng(case)
    scene = load_scene("TIHA").model_dump()
    (vessel,) = scene["inclusion"]
    vessel["modulus_kpa"] = 10 ** rng.uniform(1.7, 2.6)
    vessel["wall_mm"] = rng.uniform(0.3, 0.8)
    vessel["depth_mm"] = rng.uniform(6, 12.6)
    scene["tissue"]["modulus_kpa"] = 10 ** rng.uniform(1.0, 1.8)
    scene["pulse"]["systolic_mmhg"] = rng.uniform(110, 180)
    depth_m, aside_m = 1e-3 * rng.uniform(0.5, 3), 1e-3 * rng.uniform(-3, 3)
    return Drawn(Scene.model_validate(scene), MIDDLE_M + aside_m, depth_m)


def by_model(one: Drawn) -> Pulse:
    """At half the depth of the scan."""
    low, high = one.wave_pa
    response = plane_response.respond_plane(one.scene, one.x_m, one.depth_m)
    place = one.x_m, one.depth_m / 2
    size, full = (
        float(response.force_n(one.x_m, d, high) - response.force_n(one.x_m, d, low))
        for d in (one.depth_m / 2, one.depth_m)
    )
    rest = response.force.rest_pa
    straight = response.slope(one.x_m, one.depth_m, rest).by_pressure_n_pa * (high - low)
    return Pulse(size, float(response.pulse_error_n(*place, low, high)), float(full / straight) - 1)


def by_quick_scan(one: Drawn) -> Pulse:
    """Of a scan that has this station only; its bend without what is solved more."""
    scan = scan_estimate.estimate_scan(one.scene, [one.x_m], one.depth_m)
    (pulse,), (half,) = scan.pulse_n, scan.half_pulse_n
    return Pulse(float(pulse), float(scan.errors_n[1][0]), float(1 - 2 * half / pulse))


FOUND = {"model": by_model, "quick": by_quick_scan}


def judge(way: str, solved: str, case: int) -> Row:
    """The pulse's error in per cent, and over what is stated of it; or who refuses the press."""
    one, module = drawn(case), WAYS[way]
    kept = module.MUCH
    if solved == WITHOUT:
        module.MUCH = math.inf
    try:
        found = FOUND[way](one)
    except CannotSolve:
        return {"refused": way}
    finally:
        module.MUCH = kept
    low, high = true_n(case, one.depth_m / 2 if way == "model" else one.depth_m)
    if math.isnan(high):
        return {"refused": "press"}
    off_n = found.size_n - (high - low)
    return {"bend": f"{found.bend:.3f}", "pulse_mn": f"{1e3 * (high - low):.2f}",
            "off_pct": f"{100 * off_n / (high - low):.2f}",
            "over_stated": f"{abs(off_n) / found.error_n:.2f}"}  # fmt: skip


@lru_cache(maxsize=2)
def true_n(case: int, depth_m: float) -> tuple[float, float]:
    """Forces at both ends of the wave, or nan where `press` refuses."""
    one = drawn(case)
    ends_mmhg = [p / PA_PER_MMHG for p in one.wave_pa]
    try:
        pressed = press(one.scene, 1e3 * one.x_m, 1e3 * depth_m, ends_mmhg,
                        accuracy_pct=ACCURACY_PCT)  # fmt: skip
    except CannotSolve:
        return math.nan, math.nan
    low, high = pressed.states
    return low.force_n, high.force_n


def main(cases: int) -> None:
    """Judge, print, draw."""
    jobs = [(way, solved, case) for case in range(cases) for way in WAYS for solved in SOLVED]
    answers = ("bend", "pulse_mn", "off_pct", "over_stated", "refused")
    fill(OUT, ("way", "solved", "case"), answers, jobs, judge)
    table = pd.read_csv(OUT)
    for (way, solved, refused), some in table.dropna(subset="refused").groupby(
        ["way", "solved", "refused"]
    ):
        print(f"{way} {solved}: {len(some)} refused by {refused}")
    pairs = table[table.refused.isna()].pivot(
        index=["way", "case"], columns="solved", values=["bend", "off_pct", "over_stated"]
    ).dropna()  # fmt: skip
    for way, module in WAYS.items():
        ours = pairs.loc[way]
        much = ours["bend", WITHOUT].abs() > module.MUCH
        for name, some in (("less", ours[~much]), ("more", ours[much])):
            for solved in SOLVED:
                off, over = some["off_pct", solved].abs(), some["over_stated", solved]
                print(f"{way}, bends {name} than {module.MUCH}, {solved}: {len(some)} pulses, "
                      f"{off.median():.1f} % off, at most {off.max():.1f}; "
                      f"{over.max():.2f} of what is stated")  # fmt: skip
    draw(pairs).savefig(PICTURE, dpi=150, facecolor="white")


def draw(pairs: pd.DataFrame) -> Figure:
    """Error over what is stated, against the bend."""
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    for axes, (way, module) in zip(figure.subplots(1, 2, sharey=True), WAYS.items(), strict=True):
        ours = pairs.loc[way]
        for solved, colour in zip(SOLVED, (BLUE, VERMILLION), strict=True):
            axes.plot(ours["bend", WITHOUT].abs(), ours["over_stated", solved], "o", ms=3.5,
                      color=colour, label=solved)  # fmt: skip
        axes.axvline(module.MUCH, color="0.6", lw=1, ls="--")
        axes.axhline(1, color="0.6", lw=1)
        axes.set(xscale="log", yscale="log", xlabel="bend of the pulse", title=TITLES[way])
        axes.minorticks_off()
        axes.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axes.legend(frameon=False)
    figure.axes[0].set_ylabel("error over what is stated")
    return figure


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 80)
