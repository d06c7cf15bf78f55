"""The pictures of a run, drawn with matplotlib and sized for one column of a paper.

Each function returns a `Figure` with units on every axis; nothing here reads files.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from drivers.core.arrays import Array, Ints
from drivers.core.extras import needs
from probe.core.courses import courses_mm
from probe.core.finding_words import NORMAL_95, reach
from probe.core.places import has_rows, rows_of
from probe.core.recording import Recording, Station
from probe.core.taxel_image import beat_ends
from probe.report.look import (
    BLUE,
    GREEN,
    HEAT,
    INK,
    ON_HEAT,
    PAPER_WIDTH_IN,
    PHASE_COLOURS,
    VERMILLION,
)

with needs("report", "a report"):
    import matplotlib as mpl
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator
    from matplotlib.tri import Triangulation


SCALE_TICKS = 6  # of five digits: more run into each other
MAP_IN = 2.8  # a map's width within a column of PAPER_WIDTH_IN
UNSEEN = "not seen: below this"
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


def style() -> AbstractContextManager[None]:
    """The look of every figure; drawing and saving both belong inside."""
    return mpl.rc_context(STYLE)


def diastole_and_systole(station: Station, period_s: float) -> tuple[float, float]:
    """Lowest and highest stress [Pa] of the mean beat of a station's hold, mean over the channels:
    see `probe.core.taxel_image.beat_ends`."""
    time_s, signal = hold(station)
    low, high = beat_ends(time_s, signal.mean(axis=1)[:, None], period_s)
    return float(low[0]), float(high[0])


def hold(station: Station) -> tuple[Array, Array]:
    """Time (n,) [s] and stress (n, channels) [Pa] while the press is held."""
    begin = station.hold_s if np.isfinite(station.hold_s) else -np.inf
    end = station.retract_s if np.isfinite(station.retract_s) else np.inf
    held = (station.time_s >= begin) & (station.time_s < end)
    return station.time_s[held], station.signal_pa[held]


def is_grid(recording: Recording) -> bool:
    """Whether the stations lie in more than one row."""
    y_mm = [1e3 * s.y_m for s in recording.stations]
    return bool(np.isfinite(y_mm).all()) and has_rows(y_mm)


def grid_of(x: Array, y: Array, values: Array) -> tuple[Array, Array, Array]:
    """Columns' x (c,), rows' y (r,) and values (r, c); NaN where no station is complete."""
    (columns, i), (rows, j) = _lines(x), _lines(y)
    table = np.full((len(rows), len(columns)), np.nan)
    table[j, i] = values
    return columns, rows, table


def _lines(places_mm: Array) -> tuple[Array, Ints]:
    """Where the lines of a grid lie (m,), and the line of each place (n,)."""
    line = np.array(rows_of([1e-3 * place for place in places_mm.tolist()]), int)
    return np.bincount(line, places_mm) / np.bincount(line), line


def tactile_map(recording: Recording, heart_rate_bpm: float | None = None) -> Figure:
    """Stress of the hold at each station: its mean, and with a pulse at diastole and systole.

    One row of stations gives curves, a grid one heat map per curve on one colour scale.
    """
    maps = {"mean of the hold": np.array([s.hold_level_pa for s in recording.stations])}
    if heart_rate_bpm is not None:
        ends = [diastole_and_systole(s, 60.0 / heart_rate_bpm) for s in recording.stations]
        low, high = np.array(ends).T
        if np.isfinite(low).any():
            maps = {"diastole": low, **maps, "systole": high}
    x = np.array([1e3 * s.x_m for s in recording.stations])
    if is_grid(recording):
        y = np.array([1e3 * s.y_m for s in recording.stations])
        return heat_maps(x, y, [m / 1e3 for m in maps.values()], list(maps), "stress [kPa]")
    figure, axes = _figure("position x [mm]", "contact stress [kPa]")
    looks = {
        "diastole": (BLUE, "s--"),
        "mean of the hold": (INK, "o-"),
        "systole": (VERMILLION, "^:"),
    }
    for name, values in maps.items():
        colour, mark = looks[name]
        axes.plot(x, values / 1e3, mark, color=colour, label=name)
    if len(maps) > 1:
        _legend(figure)
    return figure


def heat_maps(
    x: Array, y: Array, maps: Sequence[Array], titles: Sequence[str], unit: str,
    ends: tuple[float, float] | None = None,
) -> Figure:  # fmt: skip
    """Several maps of one grid below each other: one colour scale, by default of what they show,
    equal axes."""
    known = [m[np.isfinite(m)] for m in maps]
    shown = np.concatenate(known) if any(map(len, known)) else np.array([0.0, 1.0])
    low, high = (float(shown.min()), float(shown.max())) if ends is None else ends
    tall = float(np.clip(MAP_IN * (np.ptp(y) + 1) / (np.ptp(x) + 1), 0.4, MAP_IN))
    figure = Figure(figsize=(PAPER_WIDTH_IN, 1.0 + len(maps) * (tall + 0.3)))
    panels = figure.subplots(len(maps), 1, sharex=True, squeeze=False)[:, 0]
    for panel, values, title in zip(panels, maps, titles, strict=True):
        columns, rows, table = grid_of(x, y, values)
        picture = panel.pcolormesh(
            columns, rows, table, cmap=HEAT, vmin=low, vmax=high, shading="nearest"
        )
        panel.set(aspect="equal", title=title, ylabel="y [mm]")
        panel.grid(False)
    panels[-1].set_xlabel("x [mm]")
    _scale_below(figure, picture, panels, unit)
    return figure


def pulse_map(finding: Mapping[str, Any], recording: Recording) -> Figure:
    """Pulse amplitude per station, with the found objects and their intervals.

    Where no pulse was seen a triangle points down: from what it is below, or in a grid's cell.
    """
    stations = finding["stations"]
    below = np.array([_number(s["pulse_below_pa"]) for s in stations])
    seen = np.isnan(below)
    pulse = np.where(seen, [_number(s["pulse_pa"]) for s in stations], np.nan)
    if is_grid(recording) and len(pulse) == len(recording.stations):
        x = np.array([1e3 * s.x_m for s in recording.stations])
        y = np.array([1e3 * s.y_m for s in recording.stations])
        known = pulse[np.isfinite(pulse)] if np.isfinite(pulse).any() else below[~seen]
        ends = (0.0, float(known.max(initial=0.0)) or 1.0)
        figure = heat_maps(x, y, [pulse], ["pulse"], "pulse [Pa]", ends)
        if not seen.all():
            figure.axes[0].plot(x[~seen], y[~seen], "v", color=INK, mfc="none", label="none seen")
        _draw_courses(figure, finding)
        if figure.axes[0].get_legend_handles_labels()[1]:
            _legend(figure)
        return figure
    figure, axes = _figure("position x [mm]", "pulse [Pa]")
    x = np.array([_number(s["x_mm"]) for s in stations])
    reaches = np.array([_number(reach(s["pulse_sd_pa"])) for s in stations])
    if seen.any():
        axes.errorbar(
            x[seen], pulse[seen], np.nan_to_num(reaches[seen]), fmt="o-", color=VERMILLION, lw=1.2,
            capsize=2, label="pulse, 95 %",
        )  # fmt: skip
    if not seen.all():
        axes.plot(x[~seen], below[~seen], "v", color=VERMILLION, mfc="none", label=UNSEEN)
    for number, one in enumerate(finding["objects"]):
        if one.get("position_mm") is None:
            continue
        if one["position_ci_mm"]:  # one station gives a place without an interval
            name = "_more" if number else "place, 95 %"  # matplotlib's legend skips _names
            axes.axvspan(*one["position_ci_mm"], color=GREEN, alpha=0.25, lw=0, label=name)
        axes.axvline(one["position_mm"], color=GREEN, lw=1, ls="--")
        axes.annotate(
            f"{one['kind']}\n{one['position_mm']:.1f} mm",
            (one["position_mm"], 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2 + 20 * (number % 2)),  # above the curve; neighbours beside each other
            textcoords="offset points",
            ha="center",
            va="bottom",
        )
    _legend(figure)
    axes.set_ylim(bottom=0)
    return figure


def _draw_courses(figure: Figure, finding: Mapping[str, Any]) -> None:
    """The objects over the map of a grid: points joined by a line, dotted where stenosed."""
    line, edge = ON_HEAT
    around = [withStroke(linewidth=3.5, foreground=edge)]
    for name, points in courses_mm(finding):
        mark = "D:" if name == "stenosed" else "o-"
        figure.axes[0].plot(*points.T, mark, color=line, path_effects=around, label=name)


def best_station(recording: Recording, finding: Mapping[str, Any]) -> tuple[Station, str]:
    """The station to show, and why: the strongest pulse, or the hardest press where none is."""
    seen = [s["pulse_pa"] if s["pulse_below_pa"] is None else None for s in finding["stations"]]
    pulse = np.array([_number(pulse_pa) for pulse_pa in seen])
    stations = recording.stations
    if finding.get("heart_rate_bpm") and len(pulse) == len(stations) and np.isfinite(pulse).any():
        return stations[int(np.nanargmax(pulse))], "the strongest pulse"
    hardest = max(stations, key=lambda s: float(s.signal_pa.mean(axis=1).max()))
    return hardest, "the hardest pressed; nothing pulses"


def force_trace(station: Station, face_m2: float, title: str) -> Figure:
    """Force against time of one station, its phases shaded."""
    figure, axes = _figure("time since first contact [s]", "force [N]")
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
        _legend(figure)
    axes.set_title(title, fontsize=8)
    return figure


def hold_down(steps: Sequence[Mapping[str, Any]]) -> Figure:
    """Force against depth and pulse against force, a curve for each station."""
    figure = Figure(figsize=(PAPER_WIDTH_IN, 2.4))
    force, pulse = figure.subplots(1, 2)
    force.set(xlabel="depth [mm]", ylabel="force [N]")
    pulse.set(xlabel="force [N]", ylabel="pulse [mN]")
    for station in dict.fromkeys(step["station"] for step in steps):
        of = [step for step in steps if step["station"] == station]
        depth_mm, force_n, pulse_mn, sd_mn = np.array([
            [_number(step["depth_mm"]), _number(step["force_n"]), 1e3 * _number(step["pulse_n"]),
             1e3 * _number(step["pulse_sd_n"])]
            for step in of
        ]).T  # fmt: skip
        force.plot(depth_mm, force_n, "o-", color=BLUE, ms=2.5, lw=0.9)
        pulse.errorbar(force_n, pulse_mn, NORMAL_95 * sd_mn, color=BLUE, fmt="o-", ms=2.5, lw=0.9)
    for axes in (force, pulse):
        axes.set_ylim(bottom=0.0)
    return figure


def section(nodes_m: Array, displacement_m: Array, triangles: Ints, von_mises_pa: Array) -> Figure:
    """The deformed section (n, 2), coloured by von Mises stress (n,) at its nodes."""
    figure = Figure(figsize=(PAPER_WIDTH_IN, 1.9))
    axes = figure.add_subplot()
    place = 1e3 * (nodes_m + displacement_m)
    mesh = Triangulation(place[:, 0], place[:, 1], triangles)
    picture = axes.tripcolor(mesh, von_mises_pa / 1e3, cmap=HEAT, shading="gouraud")
    picture.set_clim(0, float(np.percentile(von_mises_pa, 99.5)) / 1e3)
    picture.set_rasterized(True)
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="height [mm]")
    axes.grid(False)
    _scale_below(figure, picture, axes, "von Mises [kPa]")
    return figure


def _scale_below(figure: Figure, picture: Any, panels: Any, unit: str) -> None:
    figure.colorbar(
        picture, ax=panels, label=unit, location="bottom", aspect=40, pad=0.03,
        ticks=MaxNLocator(SCALE_TICKS),
    )  # fmt: skip


def _legend(figure: Figure) -> None:
    """Above the plot, never on its curves."""
    figure.legend(loc="outside upper center", ncols=4, fontsize=7, handlelength=1.6)


def mark_simulated(figure: Figure) -> None:
    """Say in the picture itself that what it shows was simulated."""
    figure.text(0.01, 0.01, "SIMULATED", fontsize=6, color=VERMILLION, ha="left", va="bottom")


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _figure(x: str, y: str) -> tuple[Figure, Axes]:
    """One plot, its axes named."""
    figure = Figure(figsize=(PAPER_WIDTH_IN, 2.4))
    return figure, figure.add_subplot(xlabel=x, ylabel=y)
