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

import palpate
from palpate import Recording, Rig, Station
from probe.deciding.coarse_to_fine import CoarseToFine
from probe.planning.planner import Press

TRUTH = {"TI": "nothing", "TIT": "tumour", "TIHA": "artery", "TISA": "stenotic artery"}
SILENT = ("undecided", "cannot see")
STARTS_MM = (4.0, 2.6, 5.3, 3.3)
BEAT_S, HOLD_S, RAMP_S = 0.825, 5.0, 1.0
NEXT_TO_NONE_MN = 0.01
"""A sensor without any noise would be taken for one that hangs."""
OUT = ROOT / "docs" / "results" / "coarse-to-fine.csv"
CACHE = Path(tempfile.gettempdir()) / "palpate-coarse-to-fine"


def rig_of(scene: str, start_mm: float, **scanned: Any) -> Rig:
    """The simulated rig over a scene."""
    plain = palpate.default_rig(palpate.load_scene(scene))
    scan = plain.scan.model_copy(update={"start_mm": start_mm, "ramp_s": RAMP_S} | scanned)
    sensor = plain.sensor[0].model_copy(update={"noise_mn": NEXT_TO_NONE_MN, "quantum_mn": 0.0})
    return plain.model_copy(update={"sensor": (sensor,), "scan": scan})


@lru_cache(maxsize=20)
def silent(scene: str, start_mm: float) -> Recording:
    """A scene's scan without noise."""
    folder = CACHE / f"{scene}-{start_mm}"
    if not list(folder.glob("*.run")):
        palpate.scan(rig_of(scene, start_mm, hold_s=HOLD_S + 1), scene, folder)
    return palpate.open_run(next(folder.glob("*.run"))).recording()


def held(one: Station, begin_s: float, hold_s: float, noise_pa: np.ndarray) -> Station:
    """A press whose hold begins ``begin_s`` into the one that was made."""
    ramp = one.time_s < one.hold_s
    begun = (one.time_s >= one.hold_s + begin_s) & (one.time_s < one.hold_s + begin_s + hold_s)
    kept = ramp | begun
    return replace(
        one, time_s=np.where(ramp, one.time_s, one.time_s - begin_s)[kept],
        signal_pa=(one.signal_pa + noise_pa)[kept], saturated=one.saturated[kept],
        depth_m=one.depth_m[kept], retract_s=one.hold_s + hold_s,
    )  # fmt: skip


def planned(planner: CoarseToFine, whole: Recording, drawn: dict[int, Any]) -> tuple[Any, Any]:
    """The stations that it presses, and how long its choices took [s]."""
    stations: dict[int, Station] = {}
    took_s = []
    by_index = {one.index: one for one in whole.stations}
    while True:
        began_s = process_time()
        choice = planner.ask()
        took_s.append(process_time() - began_s)
        if not isinstance(choice, Press):
            return tuple(stations[n] for n in sorted(stations)), took_s
        n = choice.place.index
        for hold_s in choice.holds_s:
            station = held(by_index[n], drawn[n][0], hold_s, drawn[n][1])
            reading = replace(whole, stations=(replace(station, retract_s=np.nan),))
            if hold_s < choice.holds_s[-1] and planner.enough(reading):
                break
        stations[n] = station
        planner.tell(replace(whole, stations=(station,)))


def judge(scene: str, noise_mn: float, start_mm: float, seed: int) -> Row:
    """One scan by each."""
    whole = silent(scene, start_mm)
    rng = np.random.default_rng([seed, int(10 * start_mm), int(10 * noise_mn), len(scene)])
    noise_pa = 1e-3 * noise_mn / whole.face_m2
    drawn = {
        one.index: (rng.uniform(0, BEAT_S), noise_pa * rng.standard_normal(one.signal_pa.shape))
        for one in whole.stations
    }
    raster = tuple(held(one, drawn[one.index][0], HOLD_S, drawn[one.index][1])
                   for one in whole.stations)  # fmt: skip
    plan = palpate.plan_for(rig_of(scene, start_mm, hold_s=HOLD_S))
    stations, took_s = planned(CoarseToFine(plan), whole, drawn)
    found = [palpate.detect(replace(whole, stations=s)).finding for s in (raster, stations)]
    contact_s = sum(one.retract_s - one.indent_s for one in stations)
    return {"raster": found[0], "found": found[1], "presses": len(stations),
            "contact_s": f"{contact_s:.1f}", "longest_choice_s": f"{max(took_s):.2f}",
            "choices_s": f"{sum(took_s):.2f}"}  # fmt: skip


def main(seeds: int = 3) -> None:
    """Judge, and tell what is kept."""
    jobs = [(scene, noise, start, seed) for seed in range(seeds) for start in STARTS_MM
            for noise in (0.5, 5.0) for scene in TRUTH]  # fmt: skip
    answers = ("raster", "found", "presses", "contact_s", "longest_choice_s", "choices_s")
    fill(OUT, ("scene", "noise_mn", "start_mm", "seed"), answers, jobs, judge)
    for (noise, scene), cell in pd.read_csv(OUT).groupby(["noise_mn", "scene"]):
        truth, of = TRUTH[str(scene)], len(cell)
        for who in ("raster", "found"):
            right, no = (cell[who] == truth).sum(), cell[who].isin(SILENT).sum()
            print(f"{noise} mN {scene} {who}: right {exact(right, of)} %, "
                  f"wrong {exact(of - right - no, of)} %, undecided {no} of {of}")  # fmt: skip
        print(
            f"   {cell.presses.mean():.1f} presses, {cell.contact_s.mean():.1f} s of contact, "
            f"choosing {cell.choices_s.mean():.1f} s, {cell.longest_choice_s.max():.1f} at most"
        )


if __name__ == "__main__":
    run(main)
