"""Raw readings for a calibration: a table of numbers, or a run in which the rig took them."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.errors import CalibrationError
from calibration.touch import find_contact
from drivers.core.arrays import Array
from drivers.core.extras import needs
from drivers.core.units import to_si
from probe.calibrate.table import read_table
from probe.core.contact_stress import tactile_device
from probe.core.cut_stations import compliance_m_per_n
from probe.core.events import Phase
from probe.core.places import SAME_PLACE_M
from probe.storage.run import Run, open_run

with needs("data", "palpate calibrate"):
    import pandas as pd

if TYPE_CHECKING:
    import xarray as xr

SQLITE = b"SQLite format 3\0"
COLUMNS = {
    "force": r"raw(_\d+)?|load(_\d+)?_n|temperature_c",
    "taxels": r"raw(_\d+)?|pressure_pa",
    "gravity": r"f[xyz]_n|m[xyz]_nm|r[xyz]_rad",
    "tare": r"time_s|value(_\d+)?",
    "tool": r"[xyz]_mm|r[xyz]_rad",
    "axes": r"(true_)?[xyz]_mm",
    "surface": r"[xyz]_mm",
    "latency": r"time_s|depth_mm|sensor_time_s|force_n",
    "compliance": r"depth_mm|force_n",
    "tissue": r"depth_mm|force_n|time_s|x_mm|held",
    "heart": r"time_s|reference|pressure",
}
"""What each kind may take of a table; whatever else is in it, numbers or words, is left out."""
IN_ANY_ORDER = ("force", "taxels", "gravity", "tool", "axes", "surface")
"""Kinds whose rows are readings by themselves, not a course in time or depth."""
NO_STATION = "no such complete station; press to the end first"
AROUND_S = 0.3
GOING_IN = (Phase.APPROACHING, Phase.INDENTING)


@dataclass(frozen=True)
class Measurements:
    """A table's columns; asking for one that is not there says which file and what it has.

    ``device`` is the name of the device they are of, empty where the file does not say;
    ``left_out`` are the columns that the kind of calibration has no use for. Of a table that holds
    every row ``copies`` times, as one that was pasted twice does, each counts once: the same
    readings again make nothing better known.
    """

    path: Path
    table: pd.DataFrame
    device: str = ""
    left_out: tuple[str, ...] = ()
    copies: int = 1

    @property
    def notes(self) -> tuple[str, ...]:
        """What was not taken as it stands there, in sentences."""
        said = []
        if self.left_out:
            said.append(f"columns left out: {', '.join(self.left_out)}")
        if self.copies > 1:
            said.append(f"every row is there {self.copies} times: each counts once")
        return tuple(said)

    def column(self, name: str) -> Array:
        """(n,) of one column, without the empty cells at its end: columns may differ in length."""
        if name not in self.table:
            has = ", ".join([*map(str, self.table), *self.left_out])
            raise CalibrationError(f"{self.path}: column {name} is missing; it has {has}")
        cells = self.table[name]
        filled = cells.notna().to_numpy()
        if not filled.any():
            raise CalibrationError(
                f"{self.path}: column {name} is empty: fill it, or leave it out where the kind of "
                "calibration does without"
            )
        cells = cells[: len(cells) - int(np.argmax(filled[::-1]))]
        if (gap := cells.isna().to_numpy()).any():
            raise CalibrationError(
                f"{self.path}: column {name}, row {int(cells.index[int(np.argmax(gap))]) + 1} is "
                "empty: fill it, or leave the row out of all columns"
            )
        values = pd.to_numeric(cells, errors="coerce").to_numpy(float)
        if (bad := ~np.isfinite(values)).any():
            row = int(cells.index[int(np.argmax(bad))]) + 1
            said = str(cells.iloc[int(np.argmax(bad))])
            raise CalibrationError(
                f"{self.path}: column {name}, row {row}: {said!r} is not a number"
            )
        return values

    def columns(self, *names: str) -> Array:
        """(n, k)."""
        found = [self.column(name) for name in names]
        if len({len(column) for column in found}) > 1:
            lengths = ", ".join(f"{n} has {len(c)}" for n, c in zip(names, found, strict=True))
            raise CalibrationError(f"{self.path}: columns of one length are needed: {lengths}")
        return np.column_stack(found)

    def filled(self, *names: str) -> Array:
        """(n, k), without rows that are empty in all: samples of two devices may alternate."""
        mine = self.table[[name for name in names if name in self.table]].dropna(how="all")
        return replace(self, table=mine).columns(*names)

    def numbered(self, name: str, unit: str = "") -> Array:
        """``name`` + unit, or ``name_0``, ``name_1``, … with it, all up to the last: (n, k)."""
        if name + unit in self.table:
            return self.column(name + unit)[:, None]
        found = (re.fullmatch(rf"{name}_(\d+){unit}", str(column)) for column in self.table)
        last = max((int(match[1]) for match in found if match), default=-1)
        if last < 0:
            return self.columns(name + unit)
        for number in range(last + 1):
            if f"{name}_{number}{unit}" not in self.table:
                raise CalibrationError(
                    f"{self.path}: column {name}_{number}{unit} is missing, where there is "
                    f"{name}_{last}{unit}: channels are counted from 0 without a gap; add it, or "
                    "number the columns as the sensor's channels are"
                )
        return self.columns(*(f"{name}_{number}{unit}" for number in range(last + 1)))


def read(path: Path, kind: str, device: str = "", station: int | None = None) -> Measurements:
    """A CSV table or a run file; of a run, what ``kind`` needs. Raises `CalibrationError`."""
    if not path.is_file():
        why = "a folder, pipe or device; a file is needed" if path.exists() else "no such file"
        raise CalibrationError(f"{path}: {why}")
    with path.open("rb") as file:
        if file.read(len(SQLITE)) == SQLITE:
            return _from_run(open_run(path), kind, device, station)
    if station is not None:
        raise CalibrationError(
            f"{path}: --station {station} takes a press of a run; this is a table"
        )
    table = read_table(path)
    names = [str(name) for name in table]
    used = [name for name in names if re.fullmatch(COLUMNS[kind], name)]
    # pandas names what has no name, as after a comma at the end of the header
    left_out = [
        name
        for name in names
        if name not in used and not (name.startswith("Unnamed: ") and table[name].isna().all())
    ]
    table, copies = table[used], 1
    if kind in IN_ANY_ORDER and used:
        often = table.value_counts(dropna=False)
        if len(often) > 1 and often.nunique() == 1:
            table, copies = table.drop_duplicates(), int(often.iloc[0])
    return Measurements(path, table, device, tuple(left_out), copies)


def _from_run(run: Run, kind: str, device: str, station: int | None) -> Measurements:
    if kind not in FROM_RUN:
        raise CalibrationError(
            f"{run.path}: a run has no readings for {kind}; a run gives {', '.join(FROM_RUN)}, "
            "all else is a table"
        )
    take, of_stage = FROM_RUN[kind]
    sensor = device if device in run.channels else tactile_device(run.channels)
    columns = take(run, sensor, station)
    table = pd.DataFrame({name: pd.Series(column) for name, column in columns.items()})
    return Measurements(run.path, table, device or (stage_name(run) if of_stage else sensor))


def stage_name(run: Run) -> str:
    """The stage's, as in the rig file that the run was made with."""
    stage = run.config["rig"]["stage"]
    return str(stage.get("name", stage["driver"]))


def _movement(run: Run, sensor: str, station: int | None) -> dict[str, Array]:
    """Depth and force over all presses at one place, where force belongs to depth."""
    done = _complete(run)
    first = done[done["station"] == station] if station is not None else done
    if not len(first):
        raise CalibrationError(f"{run.path}: {NO_STATION}")
    distance_mm = np.hypot(*(done[a] - first[a].iloc[0] for a in ("x_mm", "y_mm")))
    here = done[distance_mm < 1e3 * SAME_PLACE_M]["station"]
    samples = run.samples(sensor)
    samples = samples.isel(time_s=np.isin(samples["station"], here))
    first_s, last_s = (float(samples["time_s"][n]) for n in (0, -1))
    stage = run.samples("stage")  # it must be known for as long as a delay may be
    stage = stage.sel(time_s=slice(first_s - AROUND_S, last_s + AROUND_S))
    return {
        "time_s": np.array(stage["time_s"], float),
        "depth_mm": -1e3 * np.array(stage["z"], float),
        "sensor_time_s": np.array(samples["time_s"], float),
        "force_n": _force_n(run, samples),
    }


def _complete(run: Run) -> pd.DataFrame:
    table = run.stations()
    return table[table["complete"]]


def _presses(run: Run, sensor: str, station: int | None) -> list[dict[str, Array]]:
    """The way in, and the hold, of each complete press that is asked for."""
    stage = run.samples("stage")
    samples = run.samples(sensor)
    force = _force_n(run, samples)
    done = _complete(run)
    done = done if station is None else done[done["station"] == station]
    if not len(done):
        raise CalibrationError(f"{run.path}: {NO_STATION}")
    found = []
    for number, attempt in zip(done["station"], done["attempt"], strict=True):
        mine = (samples["station"] == number) & (samples["attempt"] == attempt)
        mine &= samples["phase"].isin([str(p) for p in (*GOING_IN, Phase.HOLDING)])
        time_s = np.array(samples["time_s"], float)[np.array(mine)]
        place = {a: np.interp(time_s, stage["time_s"], stage[a]) for a in "xyz"}
        inwards = np.array(samples["phase"].isin([str(p) for p in GOING_IN]))[np.array(mine)]
        found.append({"time_s": time_s, **place, "force_n": force[np.array(mine)],
                      "inwards": inwards})  # fmt: skip
    return found


def _curve(run: Run, sensor: str, station: int | None) -> dict[str, Array]:
    """One press, its depth growing inwards from anywhere, less what the rig gave way."""
    press = _presses(run, sensor, station)[0]
    depth_m = press["z"][0] - press["z"] - compliance_m_per_n(run.config) * press["force_n"]
    return {"time_s": press["time_s"], "depth_mm": 1e3 * depth_m, "force_n": press["force_n"],
            "held": 1.0 - press["inwards"], "x_mm": 1e3 * press["x"]}  # fmt: skip


def _stiffness(run: Run, sensor: str, station: int | None) -> dict[str, Array]:
    """One press's way in."""
    press = _presses(run, sensor, station)[0]
    inwards = press["inwards"]
    depth_mm = 1e3 * (press["z"][0] - press["z"][inwards])
    return {"depth_mm": depth_mm, "force_n": press["force_n"][inwards]}


def _touches(run: Run, sensor: str, station: int | None) -> dict[str, Array]:
    """Where each press first touched."""
    places = []
    for n, press in enumerate(_presses(run, sensor, station)):
        inwards = press["inwards"]
        z = press["z"][inwards]
        try:
            contact = -float(find_contact(-z, press["force_n"][inwards]).values[0])
        except CalibrationError as error:
            raise CalibrationError(f"{run.path}: press {n + 1}: {error}") from None
        there = int(np.argmin(np.abs(z - contact)))
        places.append([press["x"][inwards][there], press["y"][inwards][there], contact])
    x, y, z = 1e3 * np.array(places).T
    return {"x_mm": x, "y_mm": y, "z_mm": z}


def _pulse(run: Run, _sensor: str, _station: int | None) -> dict[str, Array]:
    for device, channels in run.channels.items():
        for channel in channels:
            if channel.role == "reference":
                samples = run.channel_samples(device)
                values = np.array(samples[channel.name], float)
                return {"time_s": np.array(samples["time_s"], float), "reference": values}
    raise CalibrationError(f"{run.path}: it has no channel of role reference (PPG, ECG)")


def _force_n(run: Run, samples: "xr.Dataset") -> Array:
    """The normal force: the channel of that role, or a pressure over the probe's face."""
    for name, channel in samples.data_vars.items():
        role, unit = channel.attrs.get("role"), channel.attrs.get("units")
        base, factor = to_si(str(unit))
        if role == "force" and base == "N":
            return factor * np.array(samples[name], float)
        if role == "pressure" and base == "Pa" and run.config.get("face_mm2"):
            area_m2 = 1e-6 * float(run.config["face_mm2"])
            return factor * area_m2 * np.array(samples[name], float)
    raise CalibrationError(f"{run.path}: its sensor reads no normal force")


Take = Callable[[Run, str, int | None], dict[str, Array]]
FROM_RUN: dict[str, tuple[Take, bool]] = {
    "latency": (_movement, False),
    "compliance": (_stiffness, True),
    "surface": (_touches, True),
    "tissue": (_curve, True),
    "heart": (_pulse, False),
}
"""What takes the columns, and whether they are the stage's."""
