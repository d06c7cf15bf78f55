"""Scans that are not as planned: what the paper's scenes in tissue are called.

    python benchmarks/odd_scans.py [SEEDS]

Each scene is scanned once by the sensor of 0.5 mN (`benchmarks/six_scenes.py`), noise drawn by
seed; what was recorded is then changed as an uneven surface, a stage or an operator would, or as an
array of nine taxels of which one fails. A wrong name is any that the scene is not; *undecided* and
*cannot see* are none. Goes on where docs/results/odd-scans.csv ends.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from kept import ROOT, Row, exact, fill, run
from six_scenes import SILENT, TRUTH, noisy

import palpate
from drivers.core.arrays import Array
from palpate import Recording
from probe.core.recording import Station

SCENES = ("TI", "TIT", "TIHA", "TISA")
SENSOR = "0.5 mN 500 Hz"
OUT = ROOT / "docs" / "results" / "odd-scans.csv"
DEPTH_MM, HIGHER_WITH_DEPTH = 2.5, 1.15
"""How deep the scenes are pressed, and the exponent of force over depth under a round finger."""
LEAST_M = 0.05e-3
"""A ramp's first depth: what is less counts as this."""
TAXELS, SPIKES, SPIKE = 9, 30, 0.5
"""Spikes in a hold of one channel, and their size over the level."""

Change = Callable[[Recording, np.random.Generator], Recording]


def only(whole: Recording, stations: Iterable[int]) -> Recording:
    """Some of the stations, in this order; one that comes twice was pressed twice."""
    chosen = [replace(whole.stations[k], index=i) for i, k in enumerate(stations)]
    return replace(whole, stations=tuple(chosen))


def deeper(whole: Recording, by_mm: Array) -> Recording:
    """Stations pressed ``by_mm`` (n,) deeper than the stage knows."""
    stations = []
    for one, by in zip(whole.stations, 1e-3 * by_mm, strict=True):
        known_m = np.maximum(one.depth_m, LEAST_M)
        grown = (np.maximum(known_m + by, LEAST_M) / known_m) ** HIGHER_WITH_DEPTH
        stations.append(replace(one, signal_pa=one.signal_pa * grown[:, None]))
    return replace(whole, stations=tuple(stations))


def wavy(size_mm: float) -> Change:
    """A surface of waves 12 to 30 mm long, trough to crest."""

    def change(whole: Recording, rng: np.random.Generator) -> Recording:
        x_mm = np.array([1e3 * one.x_m for one in whole.stations])
        turns = 2 * np.pi * x_mm / rng.uniform(12.0, 30.0) + rng.uniform(0, 2 * np.pi)
        return deeper(whole, 0.5 * size_mm * np.sin(turns))

    return change


def one_deeper(share: float) -> Change:
    def change(whole: Recording, rng: np.random.Generator) -> Recording:
        by_mm = np.zeros(len(whole.stations))
        by_mm[rng.integers(len(by_mm))] = share * DEPTH_MM
        return deeper(whole, by_mm)

    return change


def stations(count: int) -> Change:
    """A row of so few, anywhere."""

    def change(whole: Recording, rng: np.random.Generator) -> Recording:
        first = rng.integers(len(whole.stations) - count + 1)
        return only(whole, range(first, first + count))

    return change


def every_second(whole: Recording, _: np.random.Generator) -> Recording:
    return only(whole, range(1, len(whole.stations), 2))


def three_missing(whole: Recording, rng: np.random.Generator) -> Recording:
    return only(whole, sorted(rng.choice(len(whole.stations), len(whole.stations) - 3, False)))


def shuffled(whole: Recording, rng: np.random.Generator) -> Recording:
    return only(whole, rng.permutation(len(whole.stations)))


def repeated(whole: Recording, rng: np.random.Generator) -> Recording:
    return only(whole, sorted([*range(len(whole.stations)), *rng.integers(0, 15, 3)]))


def array(fail: Callable[[Array, np.random.Generator], None]) -> Change:
    """Nine taxels of unequal share and noise of their own, the fifth of which fails."""

    def change(whole: Recording, rng: np.random.Generator) -> Recording:
        share = rng.uniform(0.5, 1.5, TAXELS)

        def taxels(one: Station) -> Station:
            noise_pa = (
                3 * np.std(np.diff(one.signal_pa[:, 0][one.time_s > one.hold_s])) / np.sqrt(2)
            )
            each = one.signal_pa * share / share.mean()
            each = each + noise_pa * rng.standard_normal(each.shape)
            fail(each[:, TAXELS // 2], rng)
            return replace(one, signal_pa=each, saturated=np.zeros(each.shape, dtype=bool))

        changed = tuple(taxels(one) for one in whole.stations)
        return replace(whole, stations=changed, channels=tuple(f"t{k}" for k in range(TAXELS)))

    return change


def dead(taxel: Array, _: np.random.Generator) -> None:
    taxel[:] = np.nan


def stuck(taxel: Array, _: np.random.Generator) -> None:
    taxel[:] = 4321.0


def spikes(taxel: Array, rng: np.random.Generator) -> None:
    taxel[rng.choice(len(taxel), SPIKES, False)] *= 1 + SPIKE


def coarse(step_n: float) -> Change:
    """Rounded to steps of so much, over which a noise of 0.5 mN hardly reaches."""

    def change(whole: Recording, _: np.random.Generator) -> Recording:
        step_pa = step_n / whole.face_m2
        rounded = [replace(one, signal_pa=np.round(one.signal_pa / step_pa) * step_pa)
                   for one in whole.stations]  # fmt: skip
        return replace(whole, stations=tuple(rounded))

    return change


CHANGES: dict[str, Change] = {
    "wavy surface, 0.1 mm": wavy(0.1), "wavy surface, 0.3 mm": wavy(0.3),
    "one station 5 % deeper": one_deeper(0.05), "one station 20 % deeper": one_deeper(0.20),
    "5 stations": stations(5), "7 stations": stations(7), "8 mm apart": every_second,
    "3 stations missing": three_missing, "in any order": shuffled, "3 stations twice": repeated,
    "a dead taxel": array(dead), "a stuck taxel": array(stuck), "spikes in a taxel": array(spikes),
    **{f"resolution of {step_n:g} N": coarse(step_n) for step_n in (0.1, 0.03, 0.01, 0.003)},
}  # fmt: skip


def judge(change: str, scene: str, seed: int) -> Row:
    """One scan's finding."""
    rng = np.random.default_rng([seed, list(CHANGES).index(change), SCENES.index(scene)])
    found = palpate.detect(CHANGES[change](noisy(scene, SENSOR, seed), rng))
    best = max((one.confidence for one in found.objects), default=float("nan"))
    return {"found": found.finding, "confidence": f"{best:.4f}"}


def main(seeds: int = 20) -> None:
    """Judge, and tell what is kept."""
    jobs = [(change, scene, seed) for seed in range(seeds) for change in CHANGES
            for scene in SCENES]  # fmt: skip
    rows = fill(OUT, ("change", "scene", "seed"), ("found", "confidence"), jobs, judge)
    for change in CHANGES:
        said = [(r["scene"], r["found"]) for r in rows if r["change"] == change]
        wrong = [f"{s}: {f}" for s, f in said if f not in (TRUTH[s], "nothing", *SILENT)]
        print(f"{change}: wrong {exact(len(wrong), len(said))} % of {len(said)} {wrong}")


if __name__ == "__main__":
    run(main)
