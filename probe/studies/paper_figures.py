"""Pictures of the paper's Figs. 3 to 9, from the table of `probe.studies.paper`."""

from pathlib import Path

import numpy as np

from drivers.core.extras import needs
from probe.report.look import BLUE, GREEN, VERMILLION
from probe.studies.paper_values import FIGURES, LEVELS_MMHG, PAPER_PULSE_PA, TIMES_S

with needs("data", "palpate paper"):
    import pandas as pd
with needs("report", "palpate paper"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (VERMILLION, GREEN, BLUE)
LABELS = {
    "inclusion.0.depth_mm": "depth of the artery [mm]",
    "indentation_mm": "indentation [mm]",
    "inclusion.0.inner_diameter_mm": "inner diameter [mm]",
    "inclusion.0.modulus_kpa": "modulus of the artery [kPa]",
}


def draw(table: pd.DataFrame, out: Path) -> None:
    """Write ``maps.png`` (Figs. 3, 4), ``lone.png`` (5), ``trends.png`` (6 to 9) and
    ``readings.png``, TISA's pulse by reading of the paper."""
    _maps(table).savefig(out / "maps.png", dpi=150, facecolor="white")
    _lone(table).savefig(out / "lone.png", dpi=150, facecolor="white")
    _trends(table).savefig(out / "trends.png", dpi=150, facecolor="white")
    _readings(table).savefig(out / "readings.png", dpi=150, facecolor="white")


def _readings(table: pd.DataFrame) -> Figure:
    rows = table[table.figure == "readings"]
    names = list(dict.fromkeys(rows.reading))[::-1]
    figure = Figure(figsize=(8, 4.2), layout="constrained")
    axes = figure.subplots()
    for model, colour in (("finite", VERMILLION), ("small", BLUE)):
        some = rows[rows.model == model]
        at = [names.index(one) for one in some.reading]
        for column, mark, name in (("von_mises_pulse_pa", "o", "von Mises stress"),
                                   ("pulse_pa", "|", "contact stress")):  # fmt: skip
            axes.plot(some[column], at, mark, color=colour, ms=6, mew=2 if mark == "|" else 0,
                      label=f"{model} strain, {name}")  # fmt: skip
    axes.axvline(PAPER_PULSE_PA, color="0.5", lw=1)
    axes.annotate(f"the paper's {PAPER_PULSE_PA} Pa", (PAPER_PULSE_PA, len(names) - 0.45),
                  (4, 0), textcoords="offset points", color="0.4", fontsize=8)  # fmt: skip
    axes.set(yticks=range(len(names)), yticklabels=names, xscale="log", xlabel="pulse of TISA [Pa]",
             ylim=(-0.6, len(names)))  # fmt: skip
    ticks = [5, 10, 20, 50, 100, 200]
    axes.set_xticks(ticks, [str(t) for t in ticks])
    axes.minorticks_off()
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))
    return figure


def _maps(table: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    all_axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, scene in zip(all_axes.flat, ("TI", "TIT", "TIHA", "TISA"), strict=True):
        rows = table[(table.scene == scene) & table.figure.isin(["3", "4"])].sort_values("x_mm")
        x = np.concatenate([rows.x_mm, 64 - rows.x_mm[::-1][1:]])
        for level, time_s, colour in zip(LEVELS_MMHG, TIMES_S, COLOURS, strict=True):
            stress = rows[f"contact_pa_{level:.0f}"].to_numpy() / 1e3
            axes.plot(x, np.concatenate([stress, stress[::-1][1:]]), "o-", ms=3, color=colour,
                      label=f"{time_s} s")  # fmt: skip
        axes.set_title(f"Fig. {'3' if scene in ('TI', 'TIT') else '4'}: {scene}", loc="left")
    _labels(all_axes[:, 0], "contact stress [kPa]")
    for axes in all_axes[1]:
        axes.set_xlabel("station [mm]")
    all_axes[0, 0].legend(frameon=False)
    return figure


def _lone(table: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(6, 3), layout="constrained")
    peak, pulse = figure.subplots(1, 2)
    rows = table[(table.figure == "5") & (table.model == "finite")].set_index("scene")
    for time_s, level, colour in zip(TIMES_S, LEVELS_MMHG, COLOURS, strict=True):
        at = np.arange(2) + {1.1: -0.25, 1.3: 0.0, 1.4: 0.25}[time_s]
        peak.bar(at, rows[f"contact_pa_{level:.0f}"] / 1e3, 0.23, color=colour, label=f"{time_s} s")
    pulse.bar(np.arange(2), (rows.contact_pa_120 - rows.contact_pa_80) / 1e3, 0.5, color=BLUE)
    for axes, name in ((peak, "contact stress [kPa]"), (pulse, "pulse [kPa]")):
        axes.set(xticks=[0, 1], xticklabels=list(rows.index), ylabel=name)
    peak.legend(frameon=False)
    peak.set_title("Fig. 5: arteries out of tissue", loc="left")
    return figure


def _trends(table: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(8, 6), layout="constrained")
    all_axes = figure.subplots(2, 2)
    for axes, (number, (key, _, _)) in zip(all_axes.flat, FIGURES.items(), strict=True):
        rows = table[(table.figure == number) & (table.reason == "")]
        for (model, plane), some in rows.groupby(["model", "plane"], sort=False):
            axes.plot(some[key], some.contact_pa_120 - some.contact_pa_80,
                      "o-" if plane == "stress" else "s--", ms=3,
                      color=VERMILLION if model == "finite" else BLUE,
                      label=f"{model} strain, plane {plane}")  # fmt: skip
        axes.set(xlabel=LABELS[key], ylim=(0, None))
        axes.set_title(f"Fig. {number}", loc="left")
        if key.endswith("modulus_kpa"):
            axes.set_xscale("log")
    _labels(all_axes[:, 0], "pulse of TIHA at 32 mm [Pa]")
    all_axes[0, 0].legend(frameon=False, fontsize=8)
    return figure


def _labels(column: "np.ndarray[tuple[int], np.dtype[np.object_]]", text: str) -> None:
    axes: Axes
    for axes in column:
        axes.set_ylabel(text)
