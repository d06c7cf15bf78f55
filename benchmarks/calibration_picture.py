"""The picture of the calibrations: errors, coverage, and a wrong rig before and after."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from emulated_rig import DELAY_MS, GAIN, STIFFNESS_N_MM, TILT_MM, WrongRig
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import probe
from probe.cli import main
from probe.recording import Recording
from probe.report.look import BLUE, GREEN, ORANGE
from probe.rig import Rig
from sim_backend.response import respond

Array = NDArray[np.float64]

SCENE, TRUE_MM, TRUE_KPA = "TIT", 32.0, 50.0
FAR = 3  # a station over plain tissue, from which the modulus is taken


@dataclass(frozen=True)
class Seen:
    """One scan: mean stress by station [kPa], the depth it states and the true one [mm]."""

    label: str
    colour: str
    x_mm: Array
    stress_kpa: Array
    stated_mm: Array
    true_mm: Array
    finding: str
    modulus_kpa: tuple[float, float, float]


def draw(rows: Sequence[Any], limits: Sequence[float | None], folder: Path, out: Path) -> None:
    """Two panels of the repeats, two of the rig; prints what each scan found."""
    figure = Figure(figsize=(13, 9), layout="constrained")
    (errors, cover), (maps, depths) = figure.subplots(2, 2)
    aimed = [(r, limit) for r, limit in zip(rows, limits, strict=True) if limit is not None]
    _errors(errors, aimed)
    _coverage(cover, [r for r in rows if np.isfinite(r.coverage)])
    scans = wrong_and_right(folder)
    for one in scans:
        print(f"{one.label}: {one.finding}; modulus {one.modulus_kpa[0]:.1f} kPa "
              f"({one.modulus_kpa[1]:.1f} to {one.modulus_kpa[2]:.1f}) of {TRUE_KPA:g}; depth off "
              f"by up to {np.abs(one.stated_mm - one.true_mm).max():.3f} mm")  # fmt: skip
        maps.plot(one.x_mm, one.stress_kpa, "o-", ms=3, color=one.colour,
                  label=f"{one.label}: {one.finding}, {one.modulus_kpa[0]:.1f} kPa")  # fmt: skip
        depths.plot(one.x_mm, one.true_mm, "o-", ms=3, color=one.colour, label=f"{one.label}: true")
        depths.plot(one.x_mm, one.stated_mm, "--", color=one.colour, label=f"{one.label}: stated")
    maps.axvline(TRUE_MM, color="0.7", lw=1)
    maps.set(xlabel="x [mm]", ylabel="mean stress [kPa]",
             title=f"SIMULATED: a lump at {TRUE_MM:g} mm in {TRUE_KPA:g} kPa, one rig")  # fmt: skip
    wrongs = (f"gain {GAIN:g}, {DELAY_MS:g} ms late, {STIFFNESS_N_MM:g} N/mm, "
              f"tilted by {2 * TILT_MM:g} mm")  # fmt: skip
    depths.set(xlabel="x [mm]", ylabel="indentation [mm]", title=f"SIMULATED: {wrongs}")
    for axes in (maps, depths):
        axes.legend(fontsize=8)
    figure.savefig(out, dpi=110)


def wrong_and_right(folder: Path) -> list[Seen]:
    """The wrong rig's scan, the same with its calibrations, and one by a rig without fault."""
    rig = WrongRig(folder, SCENE, respond)
    before = _seen(rig, rig.scan("", seed=1).path, "wrong rig", ORANGE)
    rig.calibrate_all()
    after = _seen(rig, rig.scan("", seed=1).path, "calibrated", BLUE)
    plain = Rig.model_validate({"face_mm2": 100, "scene": {"name": SCENE}})
    path = probe.scan(plain, out=folder / "runs", seed=1).path
    return [before, after, _seen(None, path, "rig without fault", GREEN)]


def _seen(rig: WrongRig | None, path: Path, label: str, colour: str) -> Seen:
    recording = probe.open_run(path).recording()
    found = probe.detect(recording)
    stress = np.array([_held(recording, n, s.signal_pa[:, 0])
                       for n, s in enumerate(recording.stations)])  # fmt: skip
    stated = np.array([_held(recording, n, s.depth_m) for n, s in enumerate(recording.stations)])
    best = max(found.objects, key=lambda o: o.confidence, default=None)
    where = "nothing" if best is None else (
        f"{best.kind} at {1e3 * best.position_m:.2f} mm "
        f"({1e3 * best.position_ci_m[0]:.2f} to {1e3 * best.position_ci_m[1]:.2f})"
    )  # fmt: skip
    x_mm = np.array([1e3 * s.x_m for s in recording.stations])
    true = stated if rig is None else _true_depth(rig, path, recording, x_mm, stress)
    return Seen(label, colour, x_mm, 1e-3 * stress, 1e3 * stated, 1e3 * true, where,
                _modulus(path))  # fmt: skip


def _held(recording: Recording, station: int, values: Array) -> float:
    s = recording.stations[station]
    return float(np.median(values[(s.time_s > s.hold_s + 0.1) & (s.time_s < s.retract_s)]))


def _true_depth(
    rig: WrongRig, path: Path, recording: Recording, x_mm: Array, stress_pa: Array
) -> Array:
    """From what is wrong with the rig, not from what was calibrated."""
    stage = probe.open_run(path).samples("stage")
    gain = GAIN if "force" not in rig.files else 1.0
    slope = TILT_MM / 32
    depth = []
    for n, s in enumerate(recording.stations):
        now = (stage["time_s"].values > s.hold_s + 0.1) & (stage["time_s"].values < s.retract_s)
        x, z = (float(np.median(stage[a].values[now])) for a in "xz")
        down = slope * (x - 0.032) - z
        force = stress_pa[n] * recording.face_m2 / gain
        depth.append(down / np.hypot(1, slope) - force / (1e3 * STIFFNESS_N_MM))
    assert len(depth) == len(x_mm)
    return np.array(depth)


def _modulus(path: Path) -> tuple[float, float, float]:
    """By the command, from one press over plain tissue: the value and its interval [kPa]."""
    out = path.with_suffix(".tissue.json")
    if main(["calibrate", "tissue", str(path), "--station", str(FAR), "--scene", SCENE,
             "--out", str(out)]) != 0:  # fmt: skip
        raise RuntimeError(f"no modulus from {path}")
    told = json.loads(out.read_text())
    value = told["values"]["modulus_pa"]["value"][0]
    log, sigma = told["estimates"]["values"][0], told["estimates"]["covariance"][0][0] ** 0.5
    return (
        1e-3 * value,
        1e-3 * float(np.exp(log - 2 * sigma)),
        1e-3 * float(np.exp(log + 2 * sigma)),
    )


def _errors(axes: Axes, aimed: Sequence[tuple[Any, float]]) -> None:
    shares = [np.maximum(row.errors / limit, 1e-3) for row, limit in aimed]
    axes.boxplot(shares, orientation="horizontal", whis=(0, 95), showfliers=False)
    axes.set_yticks(range(1, len(aimed) + 1), [f"{r.name}: {r.target}" for r, _ in aimed])
    axes.axvline(1.0, color="0.3", lw=1)
    axes.set_xscale("log")
    axes.set(xlabel="error over its target (box: quartiles, whisker: 95 %)", title="Errors")


def _coverage(axes: Axes, rows: Sequence[Any]) -> None:
    at = np.arange(len(rows))
    cover = np.array([r.coverage for r in rows])
    bounds = np.array([[r.coverage - r.low, r.high - r.coverage] for r in rows]).T
    axes.axvspan(93, 97, color=GREEN, alpha=0.15)
    axes.errorbar(100 * cover, at, xerr=100 * bounds, fmt="o", color=BLUE, ms=4)
    axes.set_yticks(at, [r.name for r in rows])
    axes.set(xlabel="95 % intervals that hold the truth [%]", title="Coverage", xlim=(88, 100))
