"""The picture of a press as an array saw it."""

import numpy as np

from drivers.core.extras import needs
from probe.core.recording import Recording, Station
from probe.core.taxel_image import beat_ends, taxel_image
from probe.report.figures import hold
from probe.report.look import HEAT, INK, PAPER_WIDTH_IN

with needs("report", "a report"):
    from matplotlib.figure import Figure

PANEL_IN = 2.2


def taxels(recording: Recording, station: Station, heart_rate_bpm: float | None) -> Figure | None:
    """The mean of each taxel over the hold, and with a pulse its amplitude; row 0 below. A triangle
    points down where no taxel is. None for what is no array."""
    time_s, signal = hold(station)
    level = taxel_image(signal.mean(axis=0), recording.channels) if len(time_s) else None
    if level is None or level.size < 2:
        return None
    panels = [("mean of the hold", "stress [kPa]", level / 1e3)]
    if heart_rate_bpm is not None:
        low, high = beat_ends(time_s, signal, 60.0 / heart_rate_bpm)
        pulse = taxel_image(high - low, recording.channels)
        if pulse is not None and np.isfinite(pulse).any():
            panels.append(("pulse, lowest to highest", "pulse [Pa]", pulse))
    rows, columns = level.shape
    tall = float(np.clip(PAPER_WIDTH_IN * rows / columns, 0.5, PANEL_IN))
    figure = Figure(figsize=(PAPER_WIDTH_IN, len(panels) * (tall + 0.6)))
    for axes, (title, unit, table) in zip(
        figure.subplots(len(panels), 1, squeeze=False)[:, 0], panels, strict=True
    ):
        picture = axes.pcolormesh(
            np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5, table, cmap=HEAT
        )
        row, column = np.nonzero(np.isnan(table))
        axes.plot(column, row, "v", color=INK, mfc="none")
        axes.set(aspect="equal", title=title, xlabel="column", ylabel="row")
        axes.locator_params(integer=True)
        axes.grid(False)
        figure.colorbar(picture, ax=axes, label=unit)
    return figure
