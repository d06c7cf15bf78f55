"""Pulses of people on real tissue, person by person, with peers at equal false rates.

    pip install .[benchmarks]
    python benchmarks/pulses.py HOLDS.csv CASES PULSES.csv.gz [MORE.csv.gz...]

HOLDS: indent-and-hold recordings of tissue without a pulse; PULSES: arterial pressure (columns:
`benchmarks/real_data.py`). A stretch of a pulse, its slow wander removed, is scaled to a share of
the hold's force, trough to crest, and added at random phase. A person is what stands before the
dash in a record's name, a specimen is a curve. All goes through `probe.detection.detect`. It has
nothing that is fitted to people or specimens: the search knows the mean brachial wave of eight
others. Each way gives a score, kept for holds with and without a pulse. At a false rate its limit
lets through that share of the holds without a pulse of all specimens but the one that is judged.
Goes on where docs/results/pulses.csv ends. Draws docs/pictures/power.png.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, run
from matplotlib.figure import Figure
from real_data import holds, pulses

from drivers.core.arrays import Array, Bools
from probe.core.false_alarm import DEFAULT_FALSE_ALARM
from probe.core.recording import Recording, Station
from probe.detection import detect
from probe.detection.finding import Finding
from probe.detection.pulse.causes import MIN_POSTERIOR
from probe.detection.pulse.fit import design_of, fit, harmonics
from probe.detection.pulse.hold_samples import Hold, hold_of
from probe.detection.pulse.possible_rates import rates_hz
from probe.detection.pulse.wave import AMPLITUDES_MMHG, PHASES_RAD
from probe.report.look import BLUE, GREEN, VERMILLION

Curve = tuple[Array, Array]

CELLS = ((0.01, 5.0), (0.005, 5.0), (0.03, 2.5), (0.0025, 5.0), (0.05, 5.0), (0.03, 5.0))
"""Share of the force, and length of the hold [s]."""
BOLD = 0.5
"""False alarm at which all is asked what moves in it and the likeliest cause counts."""
DRAWN_RATES = np.linspace(0.005, 0.1, 20)
LATER_S, MOST_LATER = 1.0, 4
MATCHED_PHASES = 24
BEATS_AT_HZ, MIN_BEATS = 100, 3
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
    for start in np.arange(LATER_S, time_s[-1] - hold_s, hold_s / 2)[:MOST_LATER]:
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


def beat_quality(hold: Hold) -> float:
    """Beats found by neurokit2 (Elgendi et al. 2013), and how alike they are: the mean correlation
    with their mean (Orphanidou et al. 2015); 0 where fewer than three beats are found."""
    import neurokit2  # half a minute on a busy machine

    y, _ = _left(hold)
    time_s = np.arange(hold.time_s[0], hold.time_s[-1], 1 / BEATS_AT_HZ)
    clean = neurokit2.ppg_clean(np.interp(time_s, hold.time_s, y), sampling_rate=BEATS_AT_HZ)
    beats = neurokit2.ppg_findpeaks(clean, sampling_rate=BEATS_AT_HZ)["PPG_Peaks"]
    if len(beats) < MIN_BEATS:
        return 0.0
    try:
        quality = neurokit2.ppg_quality(clean, beats, sampling_rate=BEATS_AT_HZ)
    except ValueError:  # of three beats it makes no mean one
        return 0.0
    return float(np.nanmean(quality)) if np.isfinite(quality).any() else 0.0


def _left(hold: Hold) -> tuple[Array, Array]:
    """What relaxation and drift leave, and their basis."""
    design = design_of(hold)
    null = fit(hold, design, np.empty((len(hold.time_s), 0)))
    q, _ = np.linalg.qr(np.hstack([design.drift, design.decays[:, null.decays]]))
    return null.residual_pa - q @ (q.T @ null.residual_pa), q


PEERS: dict[str, Callable[[Hold], float]] = {
    "lock-in": lock_in, "two harmonics": lambda hold: lock_in(hold, 2),
    "matched beat": matched_beat, "neurokit2": beat_quality, "paper": peak_to_peak,
}  # fmt: skip


def named(station: Station, false_alarm: float = DEFAULT_FALSE_ALARM) -> str:
    return _finding(station, false_alarm).finding


def _finding(station: Station, false_alarm: float) -> Finding:
    return detect(Recording((station,), ("force",), (), 1e-4), false_alarm=false_alarm)


def judged(station: Station) -> Row:
    """What a hold is called, and every way's score, larger where a pulse is clearer."""
    hold = hold_of(station)
    scores = {name: f"{peer(hold):.6g}" for name, peer in PEERS.items()}
    return own_scores(station) | scores


def own_scores(station: Station) -> Row:
    """What a hold is called, and 1 less the least false alarm at which it is an artery, and at
    which something moves."""
    bold = _finding(station, BOLD)
    chance, asked = bold.stations[0].p_value, 1.0
    if bold.finding == "artery":
        sure = bold.objects[0].confidence
        odds = MIN_POSTERIOR / (1 - MIN_POSTERIOR) * (1 - sure) / sure
        asked = max(chance, DEFAULT_FALSE_ALARM * odds if sure < MIN_POSTERIOR else 0.0)
    return {"palpate": named(station), "pulse": f"{1 - asked:.6g}", "movement": f"{1 - chance:.6g}"}


def main(tissue_file: Path, cases: int, *heart_files: Path) -> None:
    """Judge, and tell what is kept."""
    tissue = holds(tissue_file)
    hearts: dict[str, list[Curve]] = {}
    for file in heart_files:
        names = list(dict.fromkeys(pd.read_csv(file, usecols=["record"]).record))
        for name, one in zip(names, pulses(file), strict=True):
            hearts.setdefault(str(name).split("-")[0], []).append(one)

    def found(share: float, hold_s: float, person: str, seed: int) -> Row:
        row = judged(of_person(seed, hold_s, share, tissue, hearts[person]))
        return row | {"specimen": seed % len(tissue)}

    def false(hold_s: float, specimen: int, part: int) -> Row:
        return judged(without(hold_s, tissue[specimen])[part])

    empty = [(h, k, part) for h in (5.0, 2.5) for k in range(len(tissue))
             for part in range(len(without(h, tissue[k])))]  # fmt: skip
    answers = ("palpate", "pulse", "movement", *PEERS)
    fill(EMPTY, ("hold_s", "specimen", "part"), answers, empty, false)
    jobs = [(*cell, person, seed) for seed in range(cases) for cell in CELLS for person in hearts]
    fill(OUT, ("share", "hold_s", "person", "seed"), ("specimen", *answers), jobs, found)
    tell()
    draw().savefig(PICTURE, dpi=150, facecolor="white")


WAYS = {"palpate": "pulse", "palpate, no causes": "movement"} | {name: name for name in PEERS}
"""Columns of the scores."""


def passing(cell: pd.DataFrame, empty: pd.DataFrame, way: str, false_rate: float) -> Bools:
    """Which holds (n,) of a cell pass at a false rate; both tables have holds of one length."""
    limit = {k: empty[empty.specimen != k][way].quantile(1 - false_rate)
             for k in cell.specimen.unique()}  # fmt: skip
    return np.asarray(cell[way] > cell.specimen.map(limit))


def _scored(cell: pd.DataFrame) -> dict[str, str]:
    """The ways that all holds of a cell were scored by."""
    return {name: way for name, way in WAYS.items() if cell[way].notna().all()}


def tables() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Holds with a pulse and without."""
    return pd.read_csv(OUT), pd.read_csv(EMPTY)


def draw() -> Figure:
    """Found against the false rate, and a star where palpate stands by default."""
    table, empties = tables()
    figure = Figure(figsize=(8, 6), layout="constrained")
    looks = {
        "palpate": (BLUE, "-"), "palpate, no causes": (BLUE, ":"),
        "matched beat": (VERMILLION, "-"),
        "lock-in": (GREEN, "-"), "two harmonics": ("0.4", "--"), "neurokit2": ("0.4", ":"),
        "paper": ("0.7", "-"),
    }  # fmt: skip
    for axes, (share, hold_s) in zip(figure.subplots(2, 2, sharex=True, sharey=True).flat,
                                     CELLS, strict=False):  # fmt: skip
        cell = table[(table.share == share) & (table.hold_s == hold_s)]
        empty = empties[empties.hold_s == hold_s]
        for name in _scored(cell):
            colour, line = looks[name]
            found = [passing(cell, empty, WAYS[name], rate).mean() for rate in DRAWN_RATES]
            axes.plot(100 * DRAWN_RATES, 100 * np.array(found), line, color=colour, label=name)
        false, right = ((one.palpate == "artery").mean() for one in (empty, cell))
        axes.plot(100 * false, 100 * right, "*", color=BLUE, ms=12, clip_on=False, zorder=3)
        axes.set_title(f"{100 * share:g} %, {hold_s:g} s, n = {len(cell)}", fontsize="medium")
        axes.set(xlim=(0, 10), ylim=(0, 100))
    figure.supxlabel(f"false pulses in holds without one [%], n = {len(empties)}")
    figure.supylabel("found [%]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, ncols=4, loc="outside upper center")
    return figure


def tell() -> None:
    """The tables of what is kept."""
    table, empties = tables()
    for hold_s, some in empties.groupby("hold_s"):
        wrong = int((some.palpate == "artery").sum())
        print(f"{hold_s} s, nothing there: artery {exact(wrong, len(some))} % of {len(some)}, "
              f"undecided {(some.palpate == 'undecided').sum()}")  # fmt: skip
    for (share, hold_s), cell in table.groupby(["share", "hold_s"]):
        empty = empties[empties.hold_s == hold_s]
        mine = (cell.palpate == "artery").groupby(cell.person).agg(["sum", "size"])
        people = ", ".join(f"{who} {one['sum']} of {one['size']}" for who, one in mine.iterrows())
        undecided = int((cell.palpate == "undecided").sum())
        print(f"{100 * share:g} % {hold_s} s: {exact(int(mine['sum'].sum()), len(cell))} % of "
              f"{len(cell)}, undecided {undecided}: {people}")  # fmt: skip
        for rate in (0.01, 0.02, 0.05):
            found = "; ".join(
                f"{name} {exact(int(passing(cell, empty, way, rate).sum()), len(cell))}"
                for name, way in _scored(cell).items()
            )
            print(f"    at {100 * rate:g} % false: {found}")


if __name__ == "__main__":
    run(main)
