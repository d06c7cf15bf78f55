"""The picture of the calibrations: errors, coverage, and a wrong rig before and after."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import palpate
from drivers.core.arrays import Array
from figures.emulated_rig import DELAY_MS, GAIN, STIFFNESS_N_MM, TILT_MM, WrongRig
from probe.cli import main
from probe.config.rig import Rig
from probe.core.recording import Recording
from probe.report.look import BLUE, GREEN, VERMILLION
from sim_backend.models.station_response import respond

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


def draw(
    rows: Sequence[Any], limits: Sequence[float | None], rigs: Sequence[Seen], out: Path
) -> None:
    """Two panels of the repeats, two of the rigs; prints what each scan found."""
    figure = Figure(figsize=(13, 10), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(1.1, 1))
    errors, cover = above.subplots(1, 2, sharey=True)
    _errors(errors, list(zip(rows, limits, strict=True)))
    _coverage(cover, rows)
    maps, depths = below.subplots(1, 2)
    for one in rigs:
        print(f"{one.label}: {one.finding}; modulus {one.modulus_kpa[0]:.1f} kPa "
              f"({one.modulus_kpa[1]:.1f} to {one.modulus_kpa[2]:.1f}) of {TRUE_KPA:g}; depth off "
              f"by up to {np.abs(one.stated_mm - one.true_mm).max():.3f} mm")  # fmt: skip
        wide = 6 if one.colour == GREEN else 1.5
        look: dict[str, Any] = {"color": one.colour, "lw": wide, "alpha": 0.35 if wide > 2 else 1}
        maps.plot(one.x_mm, one.stress_kpa, "-", **look,
                  label=f"{one.label}: {one.finding}; {one.modulus_kpa[0]:.1f} kPa")  # fmt: skip
        depths.plot(one.x_mm, one.true_mm, "-", **look, label=f"{one.label}: true")
        depths.plot(one.x_mm, one.stated_mm, ":", color=one.colour, label=f"{one.label}: stated")
    maps.axvline(TRUE_MM, color="0.7", lw=1)
    maps.set(xlabel="x [mm]", ylabel="mean stress [kPa]",
             title=f"SIMULATED: a lump at {TRUE_MM:g} mm in {TRUE_KPA:g} kPa")  # fmt: skip
    wrongs = (f"gain {GAIN:g}, {DELAY_MS:g} ms late, {STIFFNESS_N_MM:g} N/mm, "
              f"tilted by {2 * TILT_MM:g} mm")  # fmt: skip
    depths.set(xlabel="x [mm]", ylabel="indentation [mm]", title=f"SIMULATED: {wrongs}")
    low, high = maps.get_ylim()
    maps.set_ylim(low, high + 0.25 * (high - low))
    for axes in (maps, depths):
        axes.legend(fontsize=8, loc="upper left")
    figure.savefig(out, dpi=110)


def wrong_and_right(folder: Path) -> list[Seen]:
    """The wrong rig's scan, the same with its calibrations, and one by a rig without fault."""
    rig = WrongRig(folder, SCENE, respond)
    before = _seen(rig, rig.scan("", seed=1).path, "wrong rig", VERMILLION)
    rig.calibrate_all()
    after = _seen(rig, rig.scan("", seed=1).path, "calibrated", BLUE)
    plain = Rig.model_validate({"face_mm2": 100, "scene": {"name": SCENE}})
    path = palpate.scan(plain, out=folder / "runs", seed=1).path
    return [before, after, _seen(None, path, "rig without fault", GREEN)]


def _seen(rig: WrongRig | None, path: Path, label: str, colour: str) -> Seen:
    recording = palpate.open_run(path).recording()
    found = palpate.detect(recording)
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
    stage = palpate.open_run(path).samples("stage")
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
    if main(["calibrate", "tissue", str(path), "--station", str(FAR + 1), "--scene", SCENE,
             "--out", str(out)]) != 0:  # fmt: skip
        raise RuntimeError(f"no modulus from {path}")
    reported = json.loads(out.read_text())
    value = reported["values"]["modulus_pa"]["value"][0]
    log, sigma = (
        reported["estimates"]["values"][0],
        reported["estimates"]["covariance"][0][0] ** 0.5,
    )
    return (
        1e-3 * value,
        1e-3 * float(np.exp(log - 2 * sigma)),
        1e-3 * float(np.exp(log + 2 * sigma)),
    )


def _errors(axes: Axes, judged: Sequence[tuple[Any, float | None]]) -> None:
    at = [n for n, (_, limit) in enumerate(judged) if limit is not None]
    shares = [np.maximum(judged[n][0].errors / judged[n][1], 1e-3) for n in at]
    axes.boxplot(shares, positions=at, orientation="horizontal", whis=(0, 95), showfliers=False,
                 widths=0.6)  # fmt: skip
    names = [r.name if limit is None else f"{r.name}: {r.target}" for r, limit in judged]
    axes.set_yticks(range(len(judged)), names)
    axes.axvline(1.0, color="0.3", lw=1)
    axes.set_xscale("log")
    axes.set(xlabel="error over its target (box: quartiles, whisker: 95 %)", title="Errors")


def _coverage(axes: Axes, rows: Sequence[Any]) -> None:
    at = np.array([n for n, r in enumerate(rows) if np.isfinite(r.coverage)])
    cover = np.array([rows[n].coverage for n in at])
    bounds = np.array([[rows[n].coverage - rows[n].low, rows[n].high - rows[n].coverage]
                       for n in at]).T  # fmt: skip
    axes.axvspan(93, 97, color=GREEN, alpha=0.15)
    axes.errorbar(100 * cover, at, xerr=100 * bounds, fmt="o", color=BLUE, ms=4)
    axes.set(xlabel="95 % intervals that hold the truth [%]", title="Coverage", xlim=(88, 100))
    axes.invert_yaxis()
