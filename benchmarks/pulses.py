"""Pulses of people one by one, artefacts that are none, and peers at equal false rates.

    python benchmarks/pulses.py HOLDS.csv PULSES.csv.gz[,MORE.csv.gz] [CASES]

HOLDS and PULSES as for `benchmarks/power.py`; a person is what stands before the dash in a record's
name. Nothing here is tuned on a person: the search knows the mean brachial wave of eight others
and nothing of these recordings. Peers are judged at the threshold that lets through 1 % of the
holds without a pulse, which for them is set on those very holds. Artefacts are added to relaxing
presses of 5 s without a pulse, their noise 0.01 to 0.1 % of the force. Prints two tables and keeps
them in docs/pictures/pulses.csv.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from power import FALSE_ALARM, holds, pulses
from scipy.stats import beta

from probe.core.recording import Recording, Station
from probe.detection import detect
from probe.detection.pulse.fit import design_of, fit, harmonics
from probe.detection.pulse.hold_samples import Hold, hold_of
from probe.detection.pulse.search import rates_hz

Array = NDArray[np.float64]

SHARES = (0.0025, 0.005, 0.01, 0.03, 0.05)
HOLDS_S = (5.0, 2.5)
RELAXATION = ((0.179, 0.281), (0.167, 1.24), (0.277, 8.10))
LATER_S = 1.0
OUT = Path(__file__).parents[1] / "docs" / "pictures" / "pulses.csv"


def press(time_s: Array, signal: Array) -> Station:
    n = len(time_s)
    return Station(0, np.nan, np.nan, time_s, signal[:, None], np.zeros((n, 1), dtype=bool),
                   np.nan, np.nan, np.nan, np.full(n, np.nan))  # fmt: skip


def exact(count: int, of: int) -> str:
    """A share with its 95 % interval (Clopper & Pearson 1934)."""
    low = 0.0 if count == 0 else float(beta.ppf(0.025, count, of - count + 1))
    high = 1.0 if count == of else float(beta.ppf(0.975, count + 1, of - count))
    return f"{100 * count / of:.1f} ({100 * low:.1f} to {100 * high:.1f})"


def of_person(
    seed: int, hold_s: float, share: float, tissue: list[tuple[Array, Array]],
    hearts: list[tuple[Array, Array]],
) -> Station:  # fmt: skip
    """A hold with a stretch of one of a person's records."""
    rng = np.random.default_rng(seed)
    time_s, force = tissue[seed % len(tissue)]
    beat_s, wave = hearts[rng.integers(len(hearts))]
    kept = time_s <= hold_s
    start_s = rng.uniform(0.0, max(beat_s[-1] - time_s[kept][-1], 0.0))
    carried = np.where(time_s < 0, force, force.max())
    signal = force + share * carried * np.interp(time_s + start_s, beat_s, wave)
    return press(time_s[kept], signal[kept])


def without(hold_s: float, tissue: list[tuple[Array, Array]]) -> list[Station]:
    """Holds without a pulse: each curve from its ramp on, and stretches of its later hold."""
    found = []
    for time_s, force in tissue:
        found.append(press(time_s[time_s <= hold_s], force[time_s <= hold_s]))
        for start in np.arange(LATER_S, time_s[-1] - hold_s, hold_s / 2)[:4]:
            kept = (time_s >= start) & (time_s <= start + hold_s)
            found.append(press(time_s[kept], force[kept]))
    return found


def lock_in(hold: Hold, count: int = 1) -> float:
    """Share of what relaxation leaves that ``count`` harmonics at the best rate explain."""
    design = design_of(hold)
    null = fit(hold, design, np.empty((len(hold.time_s), 0)))
    q, _ = np.linalg.qr(np.hstack([design.drift, design.decays[:, null.decays]]))
    y = null.residual_pa - q @ (q.T @ null.residual_pa)
    explained = []
    for rate in rates_hz(hold.span_s):
        c = harmonics(hold.time_s, float(rate), count)
        c = c - q @ (q.T @ c)
        size, *_ = np.linalg.lstsq(c, y, rcond=None)
        explained.append(1 - float(((y - c @ size) ** 2).sum() / (y @ y)))
    return max(explained)


def peak_to_peak(hold: Hold) -> float:
    """The paper's rule: the change of the signal within the hold, over its level."""
    return float(np.ptp(hold.signal_pa) / max(abs(float(np.mean(hold.signal_pa))), 1e-300))


PEERS: dict[str, Callable[[Hold], float]] = {
    "lock-in": lock_in, "two harmonics": lambda hold: lock_in(hold, 2), "paper": peak_to_peak,
}  # fmt: skip


def relaxing(rng: np.random.Generator, rate_hz: float) -> tuple[Array, Array]:
    t = np.arange(int(5 * rate_hz)) / rate_hz
    depth = rng.uniform(0.3, 1.2)
    level = 1 - depth * sum(
        g * (1 - np.exp(-t / (tau * np.exp(0.3 * rng.normal())))) for g, tau in RELAXATION
    )
    noise = 10 ** rng.uniform(-4, -3) * np.sqrt(max(rate_hz, 50.0) / 50.0)
    return t, level + noise * rng.standard_normal(len(t))


def nothing(t: Array, _: np.random.Generator) -> Array:
    return np.zeros_like(t)


def breathing(size: float) -> Callable[[Array, np.random.Generator], Array]:
    def add(t: Array, rng: np.random.Generator) -> Array:
        turns = 2 * np.pi * rng.uniform(0.15, 0.45) * t[:, None] * np.arange(1, 6)
        sizes = np.r_[1.0, rng.uniform(0.2, 0.6) * 0.6 ** np.arange(4)]
        wave = (sizes * np.cos(turns + rng.uniform(0, 2 * np.pi, 5))).sum(axis=1)
        return np.asarray(size * wave / np.ptp(wave))

    return add


def bumps(t: Array, rng: np.random.Generator) -> Array:
    total = np.zeros_like(t)
    for _ in range(rng.integers(1, 6)):
        size, at, sd = rng.uniform(0.003, 0.03), rng.uniform(0, t[-1]), rng.uniform(0.08, 0.4)
        total += size * rng.choice([-1, 1]) * np.exp(-0.5 * ((t - at) / sd) ** 2)
    return total


def line(t: Array, rng: np.random.Generator) -> Array:
    return np.asarray(0.0015 * np.cos(2 * np.pi * rng.uniform(0.5, 4) * t + rng.uniform(0, 6.28)))


def walk(t: Array, rng: np.random.Generator) -> Array:
    return np.asarray(10 ** rng.uniform(-3, -2) * np.cumsum(rng.standard_normal(len(t)))
                      * np.sqrt(t[1]))  # fmt: skip


def tremor(t: Array, rng: np.random.Generator) -> Array:
    """8 to 13 Hz, its rate and size wandering; sampled at 10 Hz it folds onto the heart's rates."""
    fine = np.arange(0, t[-1] + 0.1, 1e-3)
    rate = rng.uniform(7, 13) + 0.01 * np.cumsum(rng.standard_normal(len(fine)))
    phase = 2 * np.pi * np.cumsum(rate) * 1e-3
    every = np.arange(0, t[-1] + 1, 0.5)
    size = 1 + 0.3 * np.interp(fine, every, rng.standard_normal(len(every)))
    return np.interp(t, fine, 10 ** rng.uniform(-3, -2) * size * np.cos(phase))


def steps(t: Array, rng: np.random.Generator) -> Array:
    total = np.zeros_like(t)
    for _ in range(rng.integers(1, 5)):
        total += rng.choice([-1, 1]) * 10 ** rng.uniform(-2.7, -1.7) * (t > rng.uniform(0, t[-1]))
    return total


def fibrillation(t: Array, rng: np.random.Generator) -> Array:
    """3 %: beats of lengths that vary by 22 %, straight up and e-fold down with a notch."""
    lengths = np.clip(rng.uniform(0.6, 0.9) * np.exp(0.22 * rng.standard_normal(40)), 0.33, 1.6)
    begins = np.cumsum(lengths) - rng.uniform(3.5, 6)
    beat = np.searchsorted(begins, t, side="right") - 1
    phase = (t - begins[beat]) / lengths[np.minimum(beat + 1, 39)]
    wave = np.where(phase < 0.15, phase / 0.15, np.exp(-(phase - 0.15) / 0.35))
    wave = wave - 0.12 * np.exp(-(((phase - 0.42) / 0.06) ** 2))
    return np.asarray(0.03 * (1 + 0.15 * rng.standard_normal(40)[beat]) * wave)


ARTEFACTS: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "nothing": nothing, "breathing 3 %": breathing(0.03),
    "breathing 10 %": breathing(0.10), "bumps": bumps, "line 0.3 %": line, "random walk": walk,
    "tremor": tremor, "steps": steps, "fibrillation 3 %": fibrillation,
}  # fmt: skip


def named(station: Station) -> str:
    return detect(Recording((station,), ("force",), (), 1e-4), false_alarm=FALSE_ALARM).finding


def people(
    tissue: list[tuple[Array, Array]], hearts: dict[str, list[tuple[Array, Array]]], cases: int
) -> list[dict[str, object]]:
    """Found by person and size; peers beside it at 1 % of the holds without a pulse."""
    rows: list[dict[str, object]] = []
    for hold_s in HOLDS_S:
        empty = without(hold_s, tissue)
        scores = {name: np.sort([score(hold_of(s)) for s in empty])
                  for name, score in PEERS.items()}  # fmt: skip
        limits = {name: s[-max(1, round(FALSE_ALARM * len(s))) - 1] for name, s in scores.items()}
        false = sum(named(s) == "artery" for s in empty)
        rows.append({"hold_s": hold_s, "share": 0.0, "person": "none", "of": len(empty),
                     "palpate": false})  # fmt: skip
        print(f"{hold_s:g} s, nothing there: {exact(false, len(empty))} % arteries", flush=True)
        for share in SHARES:
            for person, own in hearts.items():
                some = [of_person(seed, hold_s, share, tissue, own) for seed in range(cases)]
                found: dict[str, object] = {
                    name: sum(score(hold_of(s)) > limits[name] for s in some)
                    for name, score in PEERS.items()
                }
                said = [named(s) for s in some]
                found |= {"palpate": said.count("artery"), "undecided": said.count("undecided")}
                rows.append({"hold_s": hold_s, "share": share, "person": person, "of": cases}
                            | found)  # fmt: skip
                print(f"{hold_s:g} s {100 * share:g} % {person}: {found} of {cases}", flush=True)
    return rows


def artefacts(cases: int) -> list[dict[str, object]]:
    """What single presses with an artefact are called."""
    rows: list[dict[str, object]] = []
    for rate_hz in (500.0, 10.0):
        for number, (name, add) in enumerate(ARTEFACTS.items()):
            said = []
            for seed in range(cases):
                rng = np.random.default_rng([seed, number, int(rate_hz)])
                t, level = relaxing(rng, rate_hz)
                said.append(named(press(t, level + add(t, rng))))
            arteries, undecided = said.count("artery"), said.count("undecided")
            rows.append({"rate_hz": rate_hz, "artefact": name, "of": cases, "palpate": arteries,
                         "undecided": undecided})  # fmt: skip
            print(f"{rate_hz:g} Hz {name}: artery {exact(arteries, cases)} %, undecided "
                  f"{exact(undecided, cases)} %", flush=True)  # fmt: skip
    return rows


def main(tissue_file: Path, heart_files: list[Path], cases: int) -> None:
    tissue = holds(tissue_file)
    hearts: dict[str, list[tuple[Array, Array]]] = {}
    for file in heart_files:
        names = list(dict.fromkeys(pd.read_csv(file, usecols=["record"]).record))
        for name, one in zip(names, pulses(file), strict=True):
            hearts.setdefault(str(name).split("-")[0], []).append(one)
    table = pd.DataFrame(artefacts(cases) + people(tissue, hearts, cases))
    table.to_csv(OUT, index=False)
    for (hold_s, share), some in table[table.share > 0].groupby(["hold_s", "share"]):
        told = ", ".join(f"{name} {exact(int(some[name].sum()), int(some.of.sum()))}"
                         for name in ("palpate", *PEERS))  # fmt: skip
        print(f"{hold_s} s, {share} of the force: {told}")


if __name__ == "__main__":
    files = [Path(one) for one in sys.argv[2].split(",")]
    main(Path(sys.argv[1]), files, int(sys.argv[3]) if len(sys.argv) > 3 else 100)
