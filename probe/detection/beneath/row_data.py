"""What a row's presses say, as a likelihood takes it: forces along the ramp, and pulses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.core.arrays import Array
from probe.detection.pulse.presses import Press
from probe.detection.pulse.search import Search

SHARES = (0.2, 0.4, 0.7, 1.0)
"""Of the hold's depth: where on the ramp forces are taken, the last in the hold. A touch table's
presses are solved at these (`sim_backend.models.train_touch`)."""
WINDOW = 0.08
"""Of the hold's depth: as far to either side samples of the ramp are taken."""
MIN_SAMPLES = 8
"""Samples of a window, to fit a line to and to know how far they scatter."""


@dataclass(frozen=True)
class RowData:
    """``force_n`` (n, d) at ascending places ``x_m`` (n,) and depths ``sunk_m`` (d,), with standard
    deviations of noise alone, and ``pulse_n`` (n,) at the last depth, trough to crest.
    ``searches`` (n,) for the pulse, in Pa; none where a reference gave the beats."""

    x_m: Array
    sunk_m: Array
    force_n: Array
    force_sd_n: Array
    pulse_n: Array
    pulse_sd_n: Array
    searches: tuple[Search, ...] = ()

    @property
    def slope_n_per_m(self) -> Array:
        """By depth (n, d), of cubics through zero and the forces' differences."""
        depths = np.append(0.0, self.sunk_m)
        forces = np.hstack([np.zeros((len(self.x_m), 1)), self.force_n])
        return np.asarray(np.gradient(forces, depths, axis=1)[:, 1:])


def row_data(presses: Sequence[Press], face_m2: float) -> RowData | None:
    """Of presses of one row; None where they have no known place, depth or face."""
    known = sorted(
        (p for p in presses if p.pulse is not None and np.isfinite(p.station.x_m)),
        key=lambda p: p.station.x_m,
    )
    depths_m = np.array([p.station.hold_depth_m for p in known])
    if not len(known) or not np.isfinite([face_m2, *depths_m]).all():
        return None
    sunk_m = float(np.median(depths_m)) * np.array(SHARES)
    along = [_ramp_pa(p, sunk_m[:-1]) for p in known]
    if any(one is None for one in along):
        return None
    level = np.array([[*one[0], p.level_pa] for one, p in zip(along, known, strict=True) if one])
    level_sd = np.array([
        [*one[1], p.pulse.baseline_sd_pa] for one, p in zip(along, known, strict=True)
        if one and p.pulse
    ])  # fmt: skip
    if (level <= 0).any():  # logarithms are compared
        return None
    pulse, pulse_sd = np.array([_pulse_pa(p) for p in known]).T
    searches = tuple(p.pulse.search for p in known if p.pulse and p.pulse.search)
    # a beat may be anywhere in its wave while the ramp passes: about a third of it, as a deviation
    level_sd = np.hypot(level_sd, np.where(np.array(SHARES) < 1, 0.35 * pulse[:, None], 0.0))
    return RowData(
        np.array([p.station.x_m for p in known]), sunk_m, face_m2 * level, face_m2 * level_sd,
        face_m2 * pulse, face_m2 * pulse_sd, searches if len(searches) == len(known) else (),
    )  # fmt: skip


def _pulse_pa(press: Press) -> tuple[float, float]:
    """A pulse that noise alone may have made is none, give or take its own size."""
    assert press.pulse is not None
    if press.pulsing or press.pulse.p_value < 1e-3:
        return press.size_pa, press.pulse.size_sd_pa
    return 0.0, max(press.size_pa, press.pulse.size_sd_pa) / 2


def _ramp_pa(press: Press, sunk_m: Array) -> tuple[Array, Array] | None:
    """Mean signal (d,) where the ramp passes depths (d,), and its standard deviation; None where
    the ramp was not recorded."""
    station = press.station
    down = (station.time_s >= station.indent_s) & (station.time_s < station.hold_s)
    depth, signal = station.depth_m[down], station.signal_pa[down].mean(axis=1)
    good = np.isfinite(depth) & np.isfinite(signal) & ~station.saturated[down].any(axis=1)
    depth, signal = depth[good], signal[good]
    mean, deviation = [], []
    for at in sunk_m:
        near = np.abs(depth - at) <= WINDOW * station.hold_depth_m
        if near.sum() < MIN_SAMPLES:
            return None
        parabola = np.polyfit(depth[near] - at, signal[near], 2)
        scatter = (signal[near] - np.polyval(parabola, depth[near] - at)).std(ddof=3)
        mean.append(parabola[-1])
        deviation.append(1.5 * scatter / np.sqrt(near.sum()))  # a parabola's value at its middle
    return np.array(mean), np.array(deviation)
