"""How exact pulse and place are: against their bounds, against hold time and number of stations.

    python benchmarks/estimates.py [REPEATS]

Holds at 500 Hz of a brachial wave (8 harmonics, 50 to 100 beats a minute) beside a level, a drift
and white noise. The bound (Cramér-Rao) knows the rate and the number of harmonics, and nothing
else. Places are those of a lump whose level scatters by 0.4 % from station to station, 4 mm apart.
Prints two tables, draws docs/pictures/estimates.png.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from drivers.core.arrays import Array
from probe.core.recording import Recording, Station
from probe.detection.map.bumps import find_bumps
from probe.detection.map.row_shapes import shape, surroundings
from probe.detection.pulse.presses import presses_of
from probe.report.look import BLUE, VERMILLION
from sim_backend.scene.waves import BRACHIAL_AMPLITUDES, BRACHIAL_PHASES

RATE_HZ = 500.0
HOLDS_S = (0.825, 1.5, 2.5, 5.0, 10.0, 20.0)
SIGMAS = (5.0, 20.0)
STATIONS = (7, 9, 11, 15, 21)
SCATTER = 0.004
OUT = Path(__file__).parents[1] / "docs" / "pictures" / "estimates.png"
ORDER = np.arange(1, len(BRACHIAL_AMPLITUDES) + 1)


def columns(phase: Array) -> Array:
    """Cosines and sines (n, 16) of the wave's harmonics."""
    turns = 2 * np.pi * phase[:, None] * ORDER
    return np.hstack([np.cos(turns), np.sin(turns)])


def unit() -> tuple[Array, float, float]:
    """The wave's coefficients for a swing of 1, and the phases of crest and trough."""
    a, p = np.array(BRACHIAL_AMPLITUDES), np.array(BRACHIAL_PHASES)
    one = np.concatenate([a * np.cos(p), -a * np.sin(p)])
    phase = np.linspace(0, 1, 2001)
    wave = columns(phase) @ one
    swing = float(np.ptp(wave))
    return one / swing, float(phase[np.argmax(wave)]), float(phase[np.argmin(wave)])


def bound(hold_s: float, rate_hz: float, noise: float) -> float:
    """Standard deviation at best of the swing, its harmonics, level and drift unknown."""
    t = np.arange(int(hold_s * RATE_HZ)) / RATE_HZ
    _, crest, trough = unit()
    design = np.column_stack([np.ones_like(t), t / hold_s - 0.5, columns(rate_hz * t)])
    slope = columns(np.array([crest])) - columns(np.array([trough]))
    slope = np.concatenate([np.zeros(2), slope[0]])
    return float(noise * np.sqrt(slope @ np.linalg.pinv(design.T @ design) @ slope))


def size_error(hold_s: float, sigmas: float, repeats: int) -> tuple[float, float, float]:
    """Mean error and scatter of the size over its bound, and how often 95 % intervals hold."""
    rng = np.random.default_rng(int(1000 * hold_s + sigmas))
    one, *_ = unit()
    t = np.arange(int(hold_s * RATE_HZ)) / RATE_HZ
    off, inside = [], []
    for _ in range(repeats):
        rate, noise = rng.uniform(50, 100) / 60, 10.0
        sd = bound(hold_s, rate, noise)
        size = sigmas * sd
        signal = 9000.0 - 20.0 * t + size * columns(rate * t + rng.uniform()) @ one
        signal = signal + noise * rng.standard_normal(len(t))
        station = Station(
            0, 0.0, 0.0, t, signal[:, None], np.zeros((len(t), 1), dtype=bool), -1.0, -0.01,
            t[-1], np.full(len(t), 2.5e-3),
        )  # fmt: skip
        (press,) = presses_of(Recording((station,), ("force",), (), 1e-4), 0.01)
        pulse = press.pulse
        if pulse is not None:
            off.append((pulse.size_pa - size) / sd)
            inside.append(abs(pulse.size_pa - size) <= 1.96 * pulse.size_sd_pa)
    return float(np.mean(off)), float(np.std(off)), float(np.mean(inside))


def place_error(stations: int, repeats: int) -> tuple[float, float, float]:
    """Scatter of a lump's place [mm], its bound, and how often 95 % intervals hold it."""
    rng = np.random.default_rng(stations)
    x = 4.0 * np.arange(stations)
    off, inside, bounds = [], [], []
    for _ in range(repeats):
        centre = rng.uniform(x[0] + 8, x[-1] - 8)
        level = 9000 * (1 + 0.1 * shape(x, centre, 6.0)) + 5 * (x - x.mean())
        sd = np.full(stations, SCATTER * 9000)
        value = level + sd * rng.standard_normal(stations)
        found = find_bumps(1e-3 * x, value, sd, surroundings(1e-3 * x), 0.01).bumps
        if found:
            one = found[0]
            off.append(1e3 * one.x_m - centre)
            inside.append(1e3 * one.x_low_m <= centre <= 1e3 * one.x_high_m)
        bounds.append(place_bound(x, centre))
    return float(np.sqrt(np.mean(np.square(off)))), float(np.mean(bounds)), float(np.mean(inside))


def place_bound(x: Array, centre: float) -> float:
    """At best [mm]: level, tilt, height and width unknown too."""
    step = 1e-3
    by_place = (shape(x, centre + step, 6.0) - shape(x, centre - step, 6.0)) / (2 * step)
    by_width = (shape(x, centre, 6 + step) - shape(x, centre, 6 - step)) / (2 * step)
    design = np.column_stack([np.ones_like(x), x - x.mean(), shape(x, centre, 6.0),
                              0.1 * by_place, 0.1 * by_width])  # fmt: skip
    return float(SCATTER * np.sqrt(np.linalg.pinv(design.T @ design)[3, 3]))


def main(repeats: int) -> None:
    """Measure, tell, draw."""
    console = Console()
    sizes = {(h, s): size_error(h, s, repeats) for h in HOLDS_S for s in SIGMAS}
    table = Table("hold s", "pulse / bound", "mean error / bound", "variance / bound", "95 % hold",
                  title=f"Size of a pulse, {repeats} holds each")  # fmt: skip
    for (hold_s, sigmas), (mean, sd, held) in sizes.items():
        table.add_row(f"{hold_s:g}", f"{sigmas:g}", f"{mean:+.2f}", f"{sd**2:.2f}", f"{held:.3f}")
    console.print(table)
    places = {n: place_error(n, 4 * repeats) for n in STATIONS}
    table = Table("stations", "rms mm", "bound mm", "95 % hold", title="Place of a lump")
    for n, (rms, best, held) in places.items():
        table.add_row(str(n), f"{rms:.2f}", f"{best:.2f}", f"{held:.3f}")
    console.print(table)
    draw(sizes, places).savefig(OUT, dpi=150, facecolor="white")


def draw(
    sizes: dict[tuple[float, float], tuple[float, float, float]],
    places: dict[int, tuple[float, float, float]],
) -> Figure:
    """Variance over its bound against hold time; the place's error against stations."""
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for sigmas, colour in zip(SIGMAS, (BLUE, VERMILLION), strict=True):
        ratio = [sizes[h, sigmas][1] ** 2 for h in HOLDS_S]
        left.plot(HOLDS_S, ratio, "o-", color=colour, label=f"pulse of {sigmas:g} sigma")
    left.axhline(1.0, color="0.6", lw=1, ls="--")
    left.set(xscale="log", yscale="log", xlabel="hold [s]",
             ylabel="variance of the size over its bound")  # fmt: skip
    left.set_xticks(HOLDS_S, [f"{h:g}" for h in HOLDS_S])
    left.set_yticks([0.5, 1, 2, 5, 10, 20], ["0.5", "1", "2", "5", "10", "20"])
    left.minorticks_off()
    left.legend(frameon=False)
    right.plot(STATIONS, [places[n][0] for n in STATIONS], "o-", color=BLUE, label="found")
    right.plot(STATIONS, [places[n][1] for n in STATIONS], "--", color="0.5", label="bound")
    right.set(xlabel="stations, 4 mm apart", ylabel="place of a lump, rms [mm]", ylim=(0, None))
    right.legend(frameon=False)
    return figure


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
