"""The pictures of a run, drawn with matplotlib and sized for one column of a paper.

Each function returns a `Figure` with units on every axis; nothing here reads files.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from probe.recording import Recording, Station
from probe.report.look import BLUE, GREEN, HEAT, INK, ORANGE, PAPER_WIDTH_IN, PHASE_COLOURS

Array = NDArray[np.float64]

PAPER_TIMES_S = (1.1, 1.3, 1.4)  # after the ramp began, as in the paper's maps
STYLE: Any = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "svg.hashsalt": "palpate",
    "figure.constrained_layout.use": True,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": INK,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
}


@contextmanager
def style() -> Iterator[None]:
    """The look of every figure; drawing and saving both belong inside."""
    with mpl.rc_context():
        mpl.rcParams.update(STYLE)
        yield


def signal_at(station: Station, after_s: float) -> float:
    """Mean stress [Pa] over the channels, ``after_s`` after the ramp began; NaN outside."""
    start = station.indent_s if np.isfinite(station.indent_s) else station.time_s[0]
    t = start + after_s
    if len(station.time_s) < 2 or not station.time_s[0] <= t <= station.time_s[-1]:
        return float("nan")
    return float(np.interp(t, station.time_s, station.signal_pa.mean(axis=1)))


def is_grid(recording: Recording) -> bool:
    """Whether the stations lie in more than one row."""
    y = np.array([s.y_m for s in recording.stations])
    return bool(np.isfinite(y).all() and len(np.unique(np.round(y, 6))) > 1)


def grid_of(x: Array, y: Array, values: Array) -> tuple[Array, Array, Array]:
    """Columns' x (c,), rows' y (r,) and values (r, c); NaN where no station is complete."""
    columns, i = np.unique(np.round(x, 6), return_inverse=True)
    rows, j = np.unique(np.round(y, 6), return_inverse=True)
    table = np.full((len(rows), len(columns)), np.nan)
    table[j, i] = values
    return columns, rows, table


def tactile_map(recording: Recording, at_s: Sequence[float] = PAPER_TIMES_S) -> Figure:
    """Stress at each station at the given times after the ramp began: the paper's figure.

    One row of stations gives curves, a grid one heat map per time on one colour scale.
    """
    x = np.array([1e3 * s.x_m for s in recording.stations])
    maps = [np.array([signal_at(s, t) for s in recording.stations]) for t in at_s]
    if is_grid(recording):
        y = np.array([1e3 * s.y_m for s in recording.stations])
        titles = [f"{t:g} s" for t in at_s]
        return heat_maps(x, y, [m / 1e3 for m in maps], titles, "stress [kPa]")
    figure = _figure()
    axes = figure.add_subplot()
    for t, values, colour, mark in zip(
        at_s, maps, (BLUE, ORANGE, GREEN), ("o-", "s--", "^:"), strict=False
    ):
        axes.plot(x, values / 1e3, mark, color=colour, label=f"{t:g} s")
    axes.legend(title="after first contact")
    return _labelled(figure, axes, "position x [mm]", "contact stress [kPa]")


def heat_maps(
    x: Array, y: Array, maps: Sequence[Array], titles: Sequence[str], unit: str
) -> Figure:
    """Several maps of one grid side by side: one colour scale, equal axes."""
    figure = Figure(figsize=(PAPER_WIDTH_IN * max(1.0, 0.8 * len(maps)), 2.6))
    low = min((float(np.nanmin(m)) for m in maps if np.isfinite(m).any()), default=0.0)
    high = max((float(np.nanmax(m)) for m in maps if np.isfinite(m).any()), default=1.0)
    panels = [figure.add_subplot(1, len(maps), n + 1) for n in range(len(maps))]
    for panel, values, title in zip(panels, maps, titles, strict=True):
        columns, rows, table = grid_of(x, y, values)
        picture = panel.pcolormesh(
            columns, rows, table, cmap=HEAT, vmin=low, vmax=high, shading="nearest"
        )
        panel.set(aspect="equal", title=title, xlabel="x [mm]", ylabel="y [mm]")
        panel.grid(False)
    figure.colorbar(picture, ax=panels, label=unit, shrink=0.9)
    return figure


def pulse_map(finding: Mapping[str, Any], recording: Recording) -> Figure:
    """Pulse amplitude per station, with the found objects and their intervals."""
    pulse = np.array([_number(s["pulse_pa"]) for s in finding["stations"]])
    if is_grid(recording) and len(pulse) == len(recording.stations):
        x = np.array([1e3 * s.x_m for s in recording.stations])
        y = np.array([1e3 * s.y_m for s in recording.stations])
        return heat_maps(x, y, [pulse], ["pulse"], "pulse [Pa]")
    figure = _figure()
    axes = figure.add_subplot()
    x = np.array([_number(s["x_mm"]) for s in finding["stations"]])
    axes.plot(x, pulse, "o-", color=ORANGE)
    for one in finding["objects"]:
        if one.get("position_mm") is None:
            continue
        low, high = one["position_ci_mm"]
        axes.axvspan(low, high, color=GREEN, alpha=0.25, lw=0)
        axes.axvline(one["position_mm"], color=GREEN, lw=1, ls="--")
        axes.annotate(
            f"{one['kind']}\n{one['position_mm']:.1f} mm",
            (one["position_mm"], 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(4, -2),
            textcoords="offset points",
            va="top",
        )
    axes.set_ylim(bottom=0)
    return _labelled(figure, axes, "position x [mm]", "pulse [Pa]")


def best_station(recording: Recording, finding: Mapping[str, Any]) -> Station:
    """The station with the strongest pulse; without any pulse, the hardest pressed."""
    pulse = np.array([_number(s["pulse_pa"]) for s in finding["stations"]])
    stations = recording.stations
    if len(pulse) == len(stations) and np.isfinite(pulse).any() and np.nanmax(pulse) > 0:
        return stations[int(np.nanargmax(pulse))]
    return max(stations, key=lambda s: float(s.signal_pa.mean(axis=1).max()))


def force_trace(station: Station, face_m2: float) -> Figure:
    """Force against time of one station, its phases shaded."""
    figure = _figure()
    axes = figure.add_subplot()
    zero = station.indent_s if np.isfinite(station.indent_s) else station.time_s[0]
    axes.plot(station.time_s - zero, station.signal_pa.mean(axis=1) * face_m2, color=BLUE, lw=0.9)
    marks = [
        ("indenting", station.indent_s, station.hold_s),
        ("holding", station.hold_s, station.retract_s),
        ("retracting", station.retract_s, station.time_s[-1]),
    ]
    for phase, start, end in marks:
        if np.isfinite([start, end]).all() and end > start:
            colour = PHASE_COLOURS[phase]
            axes.axvspan(start - zero, end - zero, color=colour, alpha=0.18, lw=0, label=phase)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="best")
    if np.isfinite(station.x_m):
        axes.set_title(f"station {station.index} at {1e3 * station.x_m:.1f} mm", fontsize=8)
    return _labelled(figure, axes, "time since first contact [s]", "force [N]")


def section(
    nodes_m: Array, displacement_m: Array, triangles: NDArray[np.int_], von_mises_pa: Array
) -> Figure:
    """The deformed section (n, 2), coloured by von Mises stress (n,) at its nodes."""
    figure = Figure(figsize=(2 * PAPER_WIDTH_IN, 2.6))
    axes = figure.add_subplot()
    place = 1e3 * (nodes_m + displacement_m)
    mesh = Triangulation(place[:, 0], place[:, 1], triangles)
    picture = axes.tripcolor(mesh, von_mises_pa / 1e3, cmap=HEAT, shading="gouraud")
    picture.set_clim(0, float(np.percentile(von_mises_pa, 99.5)) / 1e3)
    picture.set_rasterized(True)
    axes.set(aspect="equal")
    axes.grid(False)
    figure.colorbar(picture, ax=axes, label="von Mises [kPa]", shrink=0.8)
    return _labelled(figure, axes, "x [mm]", "height [mm]")


def mark_simulated(figure: Figure) -> None:
    """Say in the picture itself that what it shows was simulated."""
    figure.suptitle("SIMULATED", fontsize=6, color=ORANGE, x=0.01, ha="left")


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _figure() -> Figure:
    return Figure(figsize=(PAPER_WIDTH_IN, 2.4))


def _labelled(figure: Figure, axes: Axes, x: str, y: str) -> Figure:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    return figure
