"""Pulses of people on real tissue, person by person, with peers at equal false rates.

    python benchmarks/pulses.py HOLDS.csv PULSES.csv.gz[,MORE.csv.gz] [CASES]

HOLDS: indent-and-hold recordings of tissue without a pulse; PULSES: arterial pressure (columns:
`benchmarks/real_data.py`). A stretch of a pulse, its slow wander removed, is scaled to a share of
the hold's force, trough to crest, and added at random phase. A person is what stands before the
dash in a record's name, a specimen is a curve. All goes through `probe.detection.detect`. It has
nothing that is fitted to people or specimens: the search knows the mean brachial wave of eight
others. A peer lets through 1 % of the holds without a pulse; its limit is set on all specimens but
the one that is judged. Goes on where docs/results/pulses.csv ends. Draws docs/pictures/power.png.
"""

import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, interval, read
from matplotlib.figure import Figure
from real_data import holds, pulses

from drivers.core.arrays import Array
from probe.core.recording import Recording, Station
from probe.detection import detect
from probe.detection.pulse.fit import design_of, fit, harmonics
from probe.detection.pulse.hold_samples import Hold, hold_of
from probe.detection.pulse.rate_prior import rates_hz
from probe.detection.pulse.wave import AMPLITUDES_MMHG, PHASES_RAD
from probe.report.look import BLUE, GREEN, ORANGE

Curve = tuple[Array, Array]

CELLS = ((0.01, 5.0), (0.005, 5.0), (0.03, 2.5), (0.0025, 5.0), (0.05, 5.0), (0.03, 5.0))
"""Share of the force, and length of the hold [s]."""
FALSE_ALARM = 0.01
LATER_S = 1.0
MATCHED_PHASES = 24
OUT = ROOT / "docs" / "results" / "pulses.csv"
EMPTY = ROOT / "docs" / "results" / "empty-presses.csv"
PICTURE = ROOT / "docs" / "pictures" / "power.png"


def press(time_s: Array, signal: Array) -> Station:
    """A recording without positions."""
    n = len(time_s)
    return Station(0, np.nan, np.nan, time_s, signal[:, None], np.zeros((n, 1), dtype=bool),
                   np.nan, np.nan, np.nan, np.full(n, np.nan))  # fmt: skip


def of_person(seed: int, hold_s: float, share: float, tissue: list[Curve],
              hearts: list[Curve]) -> Station:  # fmt: skip
    """A hold with a stretch of one of a person's records."""
    rng = np.random.default_rng(seed)
    time_s, force = tissue[seed % len(tissue)]
    beat_s, wave = hearts[rng.integers(len(hearts))]
    kept = time_s <= hold_s
    start_s = rng.uniform(0.0, max(beat_s[-1] - time_s[kept][-1], 0.0))
    carried = np.where(time_s < 0, force, force.max())
    signal = force + share * carried * np.interp(time_s + start_s, beat_s, wave)
    return press(time_s[kept], signal[kept])


def without(hold_s: float, curve: Curve) -> list[Station]:
    """Holds without a pulse: a curve from its ramp on, and stretches of its later hold."""
    time_s, force = curve
    found = [press(time_s[time_s <= hold_s], force[time_s <= hold_s])]
    for start in np.arange(LATER_S, time_s[-1] - hold_s, hold_s / 2)[:4]:
        kept = (time_s >= start) & (time_s <= start + hold_s)
        found.append(press(time_s[kept], force[kept]))
    return found


def lock_in(hold: Hold, count: int = 1) -> float:
    """Share of what relaxation leaves that ``count`` harmonics at the best rate explain."""
    y, q = _left(hold)
    explained = []
    for rate in rates_hz(hold.span_s):
        c = harmonics(hold.time_s, float(rate), count)
        c = c - q @ (q.T @ c)
        size, *_ = np.linalg.lstsq(c, y, rcond=None)
        explained.append(1 - float(((y - c @ size) ** 2).sum() / (y @ y)))
    return max(explained)


def matched_beat(hold: Hold) -> float:
    """As `lock_in`, a brachial wave at the best rate and phase."""
    y, q = _left(hold)
    order = np.arange(1, 4)
    turn = np.linspace(0, 2 * np.pi, MATCHED_PHASES, endpoint=False)[:, None] * order
    angle, size = turn + PHASES_RAD[:3], AMPLITUDES_MMHG[:3]
    mix = np.hstack([size * np.cos(angle), -size * np.sin(angle)]).T
    best = 0.0
    for rate in rates_hz(hold.span_s):
        c = harmonics(hold.time_s, float(rate), 3) @ mix
        c = c - q @ (q.T @ c)
        along = np.maximum(c.T @ y, 0.0) ** 2 / np.maximum((c**2).sum(axis=0), 1e-300)
        best = max(best, float(along.max() / (y @ y)))
    return best


def peak_to_peak(hold: Hold) -> float:
    """The paper's rule: the change of the signal within the hold, over its level."""
    return float(np.ptp(hold.signal_pa) / max(abs(float(np.mean(hold.signal_pa))), 1e-300))


def _left(hold: Hold) -> tuple[Array, Array]:
    """What relaxation and drift leave, and their basis."""
    design = design_of(hold)
    null = fit(hold, design, np.empty((len(hold.time_s), 0)))
    q, _ = np.linalg.qr(np.hstack([design.drift, design.decays[:, null.decays]]))
    return null.residual_pa - q @ (q.T @ null.residual_pa), q


PEERS: dict[str, Callable[[Hold], float]] = {
    "lock-in": lock_in, "two harmonics": lambda hold: lock_in(hold, 2),
    "matched beat": matched_beat, "paper": peak_to_peak,
}  # fmt: skip


def named(station: Station) -> str:
    return detect(Recording((station,), ("force",), (), 1e-4), false_alarm=FALSE_ALARM).finding


def main(tissue_file: Path, heart_files: list[Path], cases: int) -> None:
    """Judge, and tell what is kept."""
    tissue = holds(tissue_file)
    hearts: dict[str, list[Curve]] = {}
    for file in heart_files:
        names = list(dict.fromkeys(pd.read_csv(file, usecols=["record"]).record))
        for name, one in zip(names, pulses(file), strict=True):
            hearts.setdefault(str(name).split("-")[0], []).append(one)

    @lru_cache(maxsize=4)
    def scores(hold_s: float) -> list[dict[str, list[float]]]:
        """Of each specimen's holds without a pulse, by peer."""
        empty = [[hold_of(s) for s in without(hold_s, curve)] for curve in tissue]
        return [{n: [peer(h) for h in some] for n, peer in PEERS.items()} for some in empty]

    def found(share: float, hold_s: float, person: str, seed: int) -> Row:
        station = of_person(seed, hold_s, share, tissue, hearts[person])
        hold, own = hold_of(station), seed % len(tissue)
        row: dict[str, object] = {"palpate": named(station)}
        for name, peer in PEERS.items():
            others = [v for i, one in enumerate(scores(hold_s)) if i != own for v in one[name]]
            row[name] = int(peer(hold) > np.quantile(others, 1 - FALSE_ALARM))
        return row

    def false(hold_s: float, specimen: int, part: int) -> Row:
        return {"palpate": named(without(hold_s, tissue[specimen])[part])}

    empty = [(h, k, part) for h in (5.0, 2.5) for k in range(len(tissue))
             for part in range(len(without(h, tissue[k])))]  # fmt: skip
    fill(EMPTY, ("hold_s", "specimen", "part"), ("palpate",), empty, false)
    jobs = [(*cell, person, seed) for seed in range(cases) for cell in CELLS for person in hearts]
    fill(OUT, ("share", "hold_s", "person", "seed"), ("palpate", *PEERS), jobs, found)
    tell()
    draw().savefig(PICTURE, dpi=150, facecolor="white")


def draw() -> Figure:
    """Power against the pulse's size in holds of 5 s, beside the peers, with 95 % intervals."""
    table = pd.DataFrame(read(OUT))
    table = table[table.hold_s.astype(float) == 5.0]
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.subplots()
    ways = {"palpate": (BLUE, "o"), "matched beat": (ORANGE, "s"), "lock-in": (GREEN, "^"),
            "two harmonics": ("0.4", "d"), "paper": ("0.7", "v")}  # fmt: skip
    for place, (name, (colour, mark)) in enumerate(ways.items()):
        right = table[name].isin(["artery", "1"]).groupby(table.share.astype(float))
        count, of = right.sum().to_numpy(), right.size().to_numpy()
        size = 100 * right.mean().index.to_numpy() * (1 + 0.03 * (place - 2))
        ends = np.array([interval(int(k), int(n)) for k, n in zip(count, of, strict=True)]).T
        share = count / of
        reach = 100 * np.abs(ends - share)
        axes.errorbar(size, 100 * share, reach, color=colour, marker=mark, ms=5, lw=1.2,
                      elinewidth=0.8, label=name)  # fmt: skip
    sizes = sorted({share for share, hold_s in CELLS if hold_s == 5.0})
    axes.set(xscale="log", xlabel="pulse, trough to crest, over the force [%]", ylim=(0, 103),
             ylabel="found at 1 % false alarms [%]")  # fmt: skip
    axes.set_xticks([100 * s for s in sizes], [f"{100 * s:g}" for s in sizes])
    axes.minorticks_off()
    axes.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def tell() -> None:
    """The tables of what is kept."""
    for hold_s, some in pd.DataFrame(read(EMPTY)).groupby("hold_s"):
        wrong = int((some.palpate == "artery").sum())
        print(f"{hold_s} s, nothing there: artery {exact(wrong, len(some))} % of {len(some)}, "
              f"undecided {(some.palpate == 'undecided').sum()}")  # fmt: skip
    for (share, hold_s), cell in pd.DataFrame(read(OUT)).groupby(["share", "hold_s"]):
        whole = [("all", cell), *cell.groupby("person")]
        for person, some in whole:
            mine = int((some.palpate == "artery").sum())
            peers = "; ".join(f"{n} {exact(int((some[n] == '1').sum()), len(some))}" for n in PEERS)
            print(f"{100 * float(share):g} % {hold_s} s {person} ({len(some)}): palpate "
                  f"{exact(mine, len(some))}"
                  + (f"; {peers}" if person == "all" else ""))  # fmt: skip


if __name__ == "__main__":
    files = [Path(one) for one in sys.argv[2].split(",")]
    main(Path(sys.argv[1]), files, int(sys.argv[3]) if len(sys.argv) > 3 else 60)
