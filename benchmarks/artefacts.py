"""Artefacts that are no pulse, and hearts that are not regular: what single presses are called.

    python benchmarks/artefacts.py [CASES [HOLD_S]]

Each is added to a relaxing press of 5 s, its noise 0.01 to 0.1 % of the force, at 500 and at 10 Hz,
and of a shorter one what it begins with. Goes on where docs/results/artefacts.csv ends, or, for a
hold of 2.5 s, artefacts-2.5-s.csv.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, read, run
from pulses import named, press

from drivers.core.arrays import Array

RELAXATION = ((0.179, 0.281), (0.167, 1.24), (0.277, 8.10))
OUT = ROOT / "docs" / "results" / "artefacts.csv"
WHOLE_S = 5.0


def relaxing(rng: np.random.Generator, rate_hz: float) -> tuple[Array, Array]:
    t = np.arange(int(WHOLE_S * rate_hz)) / rate_hz
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


def flicker(t: Array, rng: np.random.Generator) -> Array:
    """Noise of a power like f^-0.8 to f^-1.3, as of electronics: 0.01 to 0.6 % of the force."""
    hz = np.fft.rfftfreq(4 * len(t), t[1])
    hz[0] = np.inf
    power = hz ** (-0.5 * rng.uniform(0.8, 1.3))
    noise = np.fft.irfft(power * (rng.standard_normal(len(hz)) + 1j * rng.standard_normal(len(hz))))
    noise = noise[: len(t)]
    return np.asarray(10 ** rng.uniform(-4, -2.2) * noise / noise.std())


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
    """3 %: beats of lengths that vary by 22 %."""
    lengths = np.clip(rng.uniform(0.6, 0.9) * np.exp(0.22 * rng.standard_normal(40)), 0.33, 1.6)
    return beating(t, lengths, rng)


def ectopic(t: Array, rng: np.random.Generator) -> Array:
    """3 %: every fifth beat comes at 0.6 of its time, and the next after a pause."""
    lengths = rng.uniform(0.7, 0.95) * (1 + 0.03 * rng.standard_normal(40))
    early = np.flatnonzero(rng.uniform(size=39) < 0.2)
    lengths[early] *= 0.6
    lengths[early + 1] *= 1.4
    return beating(t, lengths, rng)


def steady(rate_bpm: float) -> Callable[[Array, np.random.Generator], Array]:
    """3 % at a rate."""

    def add(t: Array, rng: np.random.Generator) -> Array:
        return beating(t, 60 / rate_bpm * (1 + 0.03 * rng.standard_normal(60)), rng)

    return add


def beating(t: Array, lengths: Array, rng: np.random.Generator) -> Array:
    """Beats straight up and e-fold down with a notch."""
    begins = np.cumsum(lengths) - lengths[:4].sum() - rng.uniform() * lengths[4]
    beat = np.searchsorted(begins, t, side="right") - 1
    phase = (t - begins[beat]) / lengths[np.minimum(beat + 1, len(lengths) - 1)]
    wave = np.where(phase < 0.15, phase / 0.15, np.exp(-(phase - 0.15) / 0.35))
    wave = wave - 0.12 * np.exp(-(((phase - 0.42) / 0.06) ** 2))
    return np.asarray(0.03 * (1 + 0.15 * rng.standard_normal(len(lengths))[beat]) * wave)


ARTEFACTS: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "nothing": nothing, "breathing 3 %": breathing(0.03),
    "breathing 10 %": breathing(0.10), "bumps": bumps, "line 0.3 %": line, "random walk": walk,
    "tremor": tremor, "steps": steps,
    "pulse at 70": steady(70.0), "fibrillation": fibrillation, "ectopic beats": ectopic,
    "pulse at 32": steady(32.0), "pulse at 200": steady(200.0), "flicker": flicker,
}  # fmt: skip


def judge(rate_hz: float, artefact: str, seed: int, hold_s: float = WHOLE_S) -> Row:
    """What one press is called."""
    number = list(ARTEFACTS).index(artefact)
    rng = np.random.default_rng([seed, number, int(rate_hz)])
    t, level = relaxing(rng, rate_hz)
    signal, kept = level + ARTEFACTS[artefact](t, rng), t <= hold_s
    return {"found": named(press(t[kept], signal[kept]))}


def main(cases: int = 60, hold_s: float = WHOLE_S) -> None:
    """Judge, and tell what is kept."""
    out = OUT if hold_s == WHOLE_S else OUT.with_name(f"artefacts-{hold_s:g}-s.csv")
    jobs = [(rate, name, seed) for seed in range(cases) for rate in (500.0, 10.0)
            for name in ARTEFACTS]  # fmt: skip
    answers = partial(judge, hold_s=hold_s)
    fill(out, ("rate_hz", "artefact", "seed"), ("found",), jobs, answers)
    table = pd.DataFrame(read(out))
    for (rate, name), some in table.groupby(["rate_hz", "artefact"], sort=False):
        artery, unsure = ((some.found == kind).sum() for kind in ("artery", "undecided"))
        print(f"{rate} Hz {name}: artery {exact(int(artery), len(some))} %, undecided {unsure} "
              f"of {len(some)}")  # fmt: skip


if __name__ == "__main__":
    run(main)
