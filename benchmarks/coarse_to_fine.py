"""The planner coarse-to-fine beside the raster: contact, presses, and what each scan is called.

    python benchmarks/coarse_to_fine.py [SEEDS]

Four of the paper's scenes, scanned once by a row of 15 stations that begins at four places (so that
what lies beneath is over a station, or between two), with holds of 6 s and a sensor almost without
noise. Noise of 0.5 and 5 mN is then drawn, and each hold begins anywhere in the heartbeat. The
raster holds 5 s at all stations, 90 s of contact; the planner may hold as long. Both are judged as
`palpate detect` does. Goes on where docs/results/coarse-to-fine.csv ends.
"""

import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, run
from six_scenes import NEXT_TO_NONE_MN, SILENT, TRUTH

import palpate
from palpate import Recording, Rig, Station
from probe.deciding.coarse_to_fine import CoarseToFine
from probe.planning.planner import Press

SCENES = ("TI", "TIT", "TIHA", "TISA")
NOISES_MN = {f"{plan}, {noise_mn:g} mN": noise_mn for noise_mn in (0.5, 5.0)
             for plan in ("raster", "coarse-to-fine")}  # fmt: skip
STARTS_MM, BEAT_S, HOLD_S = (4.0, 2.6, 5.3, 3.3), 0.825, 5.0
OUT = ROOT / "docs" / "results" / "coarse-to-fine.csv"
CACHE = Path(tempfile.gettempdir()) / "palpate-coarse-to-fine"


def rig_of(scene: str, start_mm: float, hold_s: float) -> Rig:
    """The simulated rig over a scene."""
    plain = palpate.default_rig(palpate.load_scene(scene))
    scan = plain.scan.model_copy(update={"start_mm": start_mm, "hold_s": hold_s})
    sensor = plain.sensor[0].model_copy(update={"noise_mn": NEXT_TO_NONE_MN, "quantum_mn": 0.0})
    return plain.model_copy(update={"sensor": (sensor,), "scan": scan})


@lru_cache(maxsize=20)
def silent(scene: str, start_mm: float) -> Recording:
    """A scene's scan without noise."""
    folder = CACHE / f"{scene}-{start_mm}"
    if not list(folder.glob("*.run")):
        palpate.scan(rig_of(scene, start_mm, HOLD_S + 1), scene, folder)
    return palpate.open_run(next(folder.glob("*.run"))).recording()


def held(one: Station, begin_s: float, noise_pa: Any, hold_s: float = HOLD_S) -> Station:
    """A press whose hold begins ``begin_s`` into the one that was made."""
    held_s = one.time_s - one.hold_s
    kept = (ramp := held_s < 0) | ((held_s >= begin_s) & (held_s < begin_s + hold_s))
    return replace(
        one, time_s=np.where(ramp, one.time_s, one.time_s - begin_s)[kept],
        signal_pa=(one.signal_pa + noise_pa)[kept], saturated=one.saturated[kept],
        depth_m=one.depth_m[kept], retract_s=one.hold_s + hold_s,
    )  # fmt: skip


def planned(planner: Any, whole: Recording, drawn: dict[int, Any]) -> tuple[list[Station], Any]:
    """The stations that it presses, and how long each of its choices took [s]."""
    pressed, took_s = dict[int, Station](), list[float]()
    while True:
        began_s = process_time()
        choice = planner.ask()
        took_s.append(process_time() - began_s)
        if not isinstance(choice, Press):
            return [pressed[n] for n in sorted(pressed)], took_s
        n = choice.place.index
        for hold_s in choice.holds_s:
            station = held(whole.stations[n], *drawn[n], hold_s)
            reading = replace(whole, stations=(replace(station, retract_s=np.nan),))
            if hold_s < choice.holds_s[-1] and planner.enough(reading):
                break
        pressed[n] = station
        planner.tell(replace(whole, stations=(station,)))


def judge(scan: str, scene: str, start_mm: float, seed: int) -> Row:
    """One scan."""
    noise_mn, whole = NOISES_MN[scan], silent(scene, start_mm)
    rng = np.random.default_rng([seed, int(10 * start_mm), int(10 * noise_mn), len(scene)])
    noise_pa = 1e-3 * noise_mn / whole.face_m2
    drawn = {
        one.index: (rng.uniform(0, BEAT_S), noise_pa * rng.standard_normal(one.signal_pa.shape))
        for one in whole.stations
    }
    if scan.startswith("raster"):
        took_s = [0.0]
        stations = [held(s, *drawn[s.index]) for s in whole.stations]
    else:
        plan = palpate.plan_for(rig_of(scene, start_mm, HOLD_S))
        stations, took_s = planned(CoarseToFine(plan), whole, drawn)
    found = palpate.detect(replace(whole, stations=tuple(stations))).finding
    contact_s = sum(one.retract_s - one.indent_s for one in stations)
    times_s = {"contact_s": contact_s, "choices_s": sum(took_s), "longest_choice_s": max(took_s)}
    return {"found": found, "presses": len(stations)} | {k: f"{v:.2f}" for k, v in times_s.items()}


def main(seeds: int = 3) -> None:
    """Judge, and tell what is kept."""
    jobs = [(scan, scene, start, seed) for seed in range(seeds) for start in STARTS_MM
            for scan in NOISES_MN for scene in SCENES]  # fmt: skip
    answers = ("found", "presses", "contact_s", "longest_choice_s", "choices_s")
    fill(OUT, ("scan", "scene", "start_mm", "seed"), answers, jobs, judge)
    for (scan, scene), cell in pd.read_csv(OUT).groupby(["scan", "scene"]):
        right, no = (cell.found == TRUTH[str(scene)]).sum(), cell.found.isin(SILENT).sum()
        shares = [exact(count, len(cell)) for count in (right, len(cell) - right - no, no)]
        print(f"{scan}, {scene}: right, wrong, undecided in % {'; '.join(shares)}")
        print(cell[["presses", *answers[2:]]].describe().loc[["mean", "max"]].to_string())


if __name__ == "__main__":
    run(main)
