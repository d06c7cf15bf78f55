"""The headline figures in one run: a whole scan, a whole small-strain scan, peers.

    python benchmarks/speed_accuracy.py [--scans | --ccx]

``--scans`` measures whole scans alone, and keeps them in `docs/results/whole-scan.csv` (delete that
file to measure them again).
Each part runs in processes of its own, from nothing, and its times are the least of three. Where
the machine does other work, the seconds of processors say more than those of the clock. Errors are
against solutions on elements of a third the size.
``--ccx`` adds CalculiX (minutes). `palpate chart speed-accuracy` draws one press by every model.
"""

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from time import perf_counter
from typing import Any

import numpy as np
from kept import ROOT, Row, fill, read

from probe.studies.charts.peers import felupe_forces, has_felupe
from probe.studies.charts.speed_accuracy import (
    DEPTH_MM,
    LEVELS_MMHG,
    X_MM,
    calculix,
    spent_s,
)
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import build_section
from sim_backend.fem.newton import Load
from sim_backend.fem.small_strain import candidates_near, condense, solve_contact
from sim_backend.models.bodies import element_size_m
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.waves import PA_PER_MMHG, load_wave

OUT = ROOT / "docs" / "results" / "whole-scan.csv"
STATIONS_M = 1e-3 * 4.0 * np.arange(1, 16)
DEPTH_M = 1e-3 * DEPTH_MM
RAMP = np.linspace(0.0, DEPTH_M, 501)[1:]
REPEATS = 3


def station(place: tuple[Scene, float]) -> np.ndarray:
    """The force [N] over the ramp and one beat at 500 Hz, at one place [m]."""
    scene, x = place
    response = respond(scene, x, DEPTH_M)
    wave = load_wave(scene.pulse)
    beat = np.arange(0.0, wave.period_s, 1 / 500)
    rest = np.full_like(RAMP, float(wave.pressure_pa(np.zeros(1))[0]))
    down = response.force_n(RAMP, rest)
    return np.concatenate([down, response.force_n(np.full_like(beat, DEPTH_M),
                                                  wave.pressure_pa(beat))])  # fmt: skip


def whole_scan(scene: Scene, workers: int) -> list[np.ndarray]:
    """Fifteen stations; those that mirror each other are solved once, by whoever meets them."""
    half = len(STATIONS_M) // 2 + 1
    places = [(scene, float(x)) for x in STATIONS_M[:half]]
    if workers == 1:
        found = [station(one) for one in places]
    else:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            found = list(pool.map(station, places))
    return [*found, *found[-2::-1]]


def small_scan(scene: Scene, coarser: float) -> np.ndarray:
    """Forces (stations, 2) [N/m] at small strain from one mesh and one factorisation, on elements
    so many times the usual size; stations that mirror each other are solved once."""
    half = STATIONS_M[: len(STATIONS_M) // 2 + 1]
    section = build_section(
        scene, float(STATIONS_M.mean()), depth_m=DEPTH_M,
        size_m=coarser * element_size_m(scene), along_surface=True,
    )  # fmt: skip
    near = [candidates_near(section, float(x), DEPTH_M) for x in half]
    body = condense(section, np.unique(np.concatenate(near)))
    found = []
    for x, touched in zip(half, near, strict=True):
        at = np.searchsorted(body.candidates, touched)
        columns = np.stack([2 * at, 2 * at + 1], axis=1).ravel()
        local = replace(body, candidates=touched,
                        compliance_columns=body.compliance_columns[:, columns])  # fmt: skip
        finger = replace(section.finger, x=float(x))
        loads = [Load(DEPTH_M, p * PA_PER_MMHG) for p in LEVELS_MMHG]
        found.append([solve_contact(local, finger, load).force_n_per_m for load in loads])
    return np.array([*found, *found[-2::-1]])


def one_press(scene: Scene, size_m: float) -> tuple[list[float], int]:
    """Forces [N/m] at both levels, and degrees of freedom."""
    levels = [p * PA_PER_MMHG for p in LEVELS_MMHG]
    section, found = solve_finite(scene, 1e-3 * X_MM, DEPTH_M, levels, size_m)
    return [one.force_n_per_m for one in found], len(section.assembly.free)


def by_felupe(scene: Scene, size_m: float) -> tuple[list[float], int]:
    """As `one_press`, by FElupe."""
    levels = [p * PA_PER_MMHG for p in LEVELS_MMHG]
    return felupe_forces(scene, 1e-3 * X_MM, DEPTH_M, levels, size_m)


def by_calculix(scene: Scene, size_m: float) -> tuple[list[float], int]:
    """As `one_press`, by CalculiX."""
    low, pulse, size = calculix(scene, 1e3 * size_m)
    return [low, low + pulse], size


@dataclass(frozen=True)
class Timed:
    """Seconds by the clock and of processors, with children's, and peak memory."""

    answer: Any
    seconds: float
    cpu_s: float
    peak_mb: float

    def __str__(self) -> str:
        return f"{self.seconds:.2f} s by the clock, {self.cpu_s:.2f} s of processors"


def _timed(solve: Callable[..., Any], arguments: tuple[Any, ...]) -> Timed:
    began, spent = perf_counter(), spent_s()
    answer = solve(*arguments)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Timed(answer, perf_counter() - began, spent_s() - spent, peak_mb)


def fresh(solve: Callable[..., Any], *arguments: Any, repeats: int = REPEATS) -> Timed:
    """The least of ``repeats``, each in a new process."""
    found = []
    for _ in range(repeats):
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            found.append(pool.submit(_timed, solve, arguments).result())
    least = min(found, key=lambda one: one.seconds)
    return replace(least, cpu_s=min(one.cpu_s for one in found))


def off_pct(forces: Sequence[float], truth: Sequence[float]) -> str:
    """Errors of force and pulse."""
    (a, b), (c, d) = forces, truth
    return f"force {100 * (a / c - 1):+.3f} %, pulse {100 * ((b - a) / (d - c) - 1):+.2f} %"


def scans(scene: Scene) -> None:
    """Whole scans at finite and at small strain, and as the command, kept."""
    fill(OUT, ("what",), ("clock_s", "processor_s", "peak_mb", "force_error_pct", "pulse_error_pct",
         "load"), [(name,) for name in SCANS], lambda name: SCANS[name](scene))  # fmt: skip
    for row in read(OUT):
        print(", ".join(f"{key} {value}" for key, value in row.items() if value))


def row_of_scan(timed: Timed, **errors: float) -> Row:
    """What is kept of one."""
    return {
        "clock_s": f"{timed.seconds:.2f}", "processor_s": f"{timed.cpu_s:.2f}",
        "peak_mb": f"{timed.peak_mb:.0f}", "load": f"{os.getloadavg()[0]:.1f}",
        **{key: f"{value:.2g}" for key, value in errors.items()},
    }  # fmt: skip


def finite(scene: Scene, workers: int) -> Row:
    """At finite strain; with one process the largest errors at three places too."""
    timed = fresh(whole_scan, scene, workers)
    if workers > 1:
        return row_of_scan(timed)
    levels = [p * PA_PER_MMHG for p in LEVELS_MMHG]
    length_m = 1e-3 * scene.indenter.length_mm
    off = []
    for x in (16e-3, 24e-3, 32e-3):
        low, high = respond(scene, x, DEPTH_M).force_n(np.full(2, DEPTH_M), np.array(levels))
        _, found = solve_finite(scene, x, DEPTH_M, levels, element_size_m(scene) / 3)
        a, b = (length_m * one.force_n_per_m for one in found)
        off.append((100 * abs(low / a - 1), 100 * abs((high - low) / (b - a) - 1)))
    force, pulse = np.max(off, axis=0)
    return row_of_scan(timed, force_error_pct=force, pulse_error_pct=pulse)


def small(scene: Scene) -> Row:
    """At small strain, against its own limit."""
    timed = fresh(small_scan, scene, 2.0)
    finer = fresh(small_scan, scene, 0.7, repeats=1)
    return row_of_scan(timed, force_error_pct=100 * np.abs(timed.answer / finer.answer - 1).max())


def command(scene: Scene) -> Row:
    """`palpate scan`, its interpreter's start included; the median of seven by the clock."""
    times, spent = [], []
    said = [sys.executable, "-m", "probe.cli", "scan", "--scene", str(scene.name), "--seed", "1"]
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(7):
            began, before = perf_counter(), spent_s()
            subprocess.run([*said, "--out", folder], check=True, capture_output=True)
            times.append(perf_counter() - began)
            spent.append(spent_s() - before)
    return {"clock_s": f"{np.median(times):.2f}", "processor_s": f"{np.median(spent):.2f}",
            "load": f"{os.getloadavg()[0]:.1f}"}  # fmt: skip


SCANS: dict[str, Callable[[Scene], Row]] = {
    "finite strain, one process": lambda scene: finite(scene, 1),
    "finite strain, two processes": lambda scene: finite(scene, 2),
    "small strain": small,
    "palpate scan --scene TIHA": command,
}


def peers(scene: Scene, names: Sequence[str]) -> None:
    """One press by ours and by others, in plane strain."""
    truth, _ = one_press(scene, 0.2e-3)
    solvers = {"ours": one_press, "FElupe": by_felupe, "CalculiX": by_calculix}
    ours_s = np.inf
    for name in names:
        for size_m in (1.4e-3, 0.7e-3) if name == "ours" else (1.4e-3,):
            one = fresh(solvers[name], scene, size_m, repeats=REPEATS if name == "ours" else 1)
            ours_s = min(ours_s, one.cpu_s)
            print(f"one press, plane strain, {name} at {1e3 * size_m:g} mm: {one} "
                  f"({one.cpu_s / ours_s:.1f} x our least), "
                  f"{off_pct(one.answer[0], truth)}")  # fmt: skip


def main() -> None:
    """Print all parts."""
    scene = load_scene("TIHA")
    strain = scene.model_copy(update={"plane": "strain"})
    scans(scene)
    if "--scans" in sys.argv:
        return
    names = ["ours", *(["FElupe"] if has_felupe() else [])]
    peers(strain, [*names, *(["CalculiX"] if "--ccx" in sys.argv else [])])


if __name__ == "__main__":
    main()
