"""Real presses by a skin of seven taxels, in counts: is a nodule seen by presses over nothing?

    python benchmarks/real_arrays.py PRESSES.csv.gz

PRESSES has the columns press, label ("na": nothing), x_m, y_m and taxel0_counts ... of a press's
frames. Each place over nothing is left out in turn: its presses give the false alarms, those over
the nodules are to be found, and both are compared with some presses over nothing at the other
places, drawn anew `DRAWS` times. Beside it, classifiers by the nearest mean: of the same presses,
and of these and as many at the nodules but the one that is judged. Areas under the curve have 95 %
intervals by bootstrap over places of both kinds, shares by press (Clopper & Pearson). Results go
to docs/results/real-arrays.csv.
"""

from itertools import combinations, product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, run
from scipy.stats import mannwhitneyu

from drivers.core.arrays import Array
from probe.detection.unlike_empty import films_of, places_of, unlike
from probe.storage.csv_import import import_csv
from probe.storage.run import open_run

OUT = ROOT / "docs" / "results" / "real-arrays.csv"
PRESSES = (12, 21, 42, 99)  # as many at each of three places
DRAWS, LABEL_DRAWS, BOOTSTRAPS = 10, 3, 2000
FALSE_ALARM = 0.1
MAPPING: dict[str, str | list[str]] = {
    "station": "press", "x_mm": "x_m [m]", "y_mm": "y_m [m]", "taxels_counts": "taxel*",
}  # fmt: skip
WAYS = ("unlike", "nearest mean", "nearest of two")
STATED = ("alarms % at 10", "found % at 10", "alarms % at 10 by press")
ANSWERS = (*(f"{way}: {what}" for way in WAYS for what in ("area", "found %")), *STATED, "rank")


def area(empty: Array, nodule: Array) -> float:
    """Under the curve: the chance that a press over a nodule scores more than one over nothing."""
    return float(mannwhitneyu(nodule, empty).statistic / len(nodule) / len(empty))


def off(films: Array, seen: Array, middle: Array) -> Array:
    """Squared distance (n,) from the mean of ``middle``, in standard deviations of ``seen``."""
    return np.asarray((((films - middle.mean(axis=0)) / seen.std(axis=0)) ** 2).sum(axis=1))


def main(file: Path) -> None:
    """Import, judge, and tell what is kept."""
    with TemporaryDirectory() as folder:
        made = import_csv(file, Path(folder) / "presses.run", mapping=MAPPING, rate_hz=1.2)
        recording = open_run(made.path).recording(any_unit=True)
        films, place = films_of(recording), places_of(recording)
    labels = pd.read_csv(file).groupby("press").label.first().to_numpy()
    empty, lumps = (np.unique(place[over_lump]) for over_lump in (labels == "na", labels != "na"))

    def drawn(count: int, draw: int, places: Array, out: int) -> Array:
        rng, others = np.random.default_rng([draw, count, out]), np.setdiff1d(places, out)
        each = [np.flatnonzero(place == one) for one in others]
        return np.concatenate([rng.choice(own, count // len(others), False) for own in each])

    def rank(count: int) -> str:
        """Of the true places over nothing among all choices of as many, by the mean area."""
        means = {}
        for four in combinations(np.unique(place), len(empty)):
            each = []
            for out, draw in product(four, range(LABEL_DRAWS)):
                some = drawn(count, draw, np.array(four), out)
                distance, _ = unlike(films, films[some], place[some])
                each.append(area(distance[place == out], distance[~np.isin(place, four)]))
            means[four] = np.mean(each)
        return f"{sum(m >= means[tuple(empty)] for m in means.values())} of {len(means)}"

    def judge(count: int) -> Row:
        areas, finds = np.zeros((len(WAYS), len(empty), len(lumps))), np.zeros(len(WAYS))
        stated = np.zeros(len(STATED))
        for (i, out), (j, lump), draw in product(enumerate(empty), enumerate(lumps), range(DRAWS)):
            held, over = place == out, place == lump
            some, more = drawn(count, draw, empty, out), drawn(count, draw, lumps, lump)
            seen, other = films[some], films[more]
            both = np.concatenate([seen, other])
            distance, chance = unlike(films, seen, place[some])
            _, by_press = unlike(films, seen, np.zeros(count, np.int64))
            two = off(films, both, seen) - off(films, both, other)
            for way, score in enumerate((distance, off(films, seen, seen), two)):
                areas[way, i, j] += area(score[held], score[over]) / DRAWS
                found = score[over] > np.quantile(score[held], 1 - FALSE_ALARM)
                finds[way] += found.sum() / DRAWS / len(empty)
            called = [
                ranks <= FALSE_ALARM for ranks in (chance[held], chance[over], by_press[held])
            ]
            stated += [100 * one.mean() / areas[0].size / DRAWS for one in called]
        rng = np.random.default_rng(0)
        cells = []
        for each, count_found in zip(areas, finds, strict=True):
            again = [each[np.ix_(*(rng.integers(0, n, n) for n in each.shape))].mean()
                     for _ in range(BOOTSTRAPS)]  # fmt: skip
            low, high = np.quantile(again, [0.025, 0.975])
            cells += [f"{each.mean():.3f} ({low:.2f} to {high:.2f})"]
            cells += [exact(round(count_found), int((labels != "na").sum()))]
        cells += [f"{share:.1f}" for share in stated]
        return dict(zip(ANSWERS, [*cells, rank(count)], strict=True))

    for row in fill(OUT, ("presses",), ANSWERS, [(count,) for count in PRESSES], judge):
        print(row)


if __name__ == "__main__":
    run(main)
