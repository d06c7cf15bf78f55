"""Calibrations from readings: which columns each needs, and the tissue's by the phantom.

The fits themselves are in `calibration` and know neither files nor finite elements.
"""

import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

import calibration
from calibration.errors import CalibrationError
from calibration.low_pass import fit_low_pass
from calibration.touch import find_contact
from drivers.core.arrays import Array
from probe.calibrate.measurements import COLUMNS, Measurements, read
from probe.calibrate.tissue_force import KNOWN, force_of_modulus
from probe.calibrate.units import check_units
from sim_backend.scene.scene_file import Scene, as_scene

HALF = 0.5
"""Of the block: a surface that a fit puts further above the deepest reading is none."""


@dataclass(frozen=True)
class Choices:
    """What a person may say beside the readings; each is of one kind.

    ``surface_model``: plane, quadric or map. ``scene``: block and finger of a tissue.
    ``relaxation_s``: a guess of each relaxation time wanted. ``cuff_mmhg``: systolic, diastolic.
    """

    surface_model: Any = "plane"
    scene: Scene | None = None
    relaxation_s: tuple[float, ...] = ()
    cuff_mmhg: tuple[float, float] = (120.0, 80.0)


def calibrate(
    kind: str,
    measurements: str | Path,
    *,
    device: str = "",
    station: int | None = None,
    surface_model: Literal["plane", "quadric", "map"] = "plane",
    scene: Scene | str | Path = "TI",
    relaxation_s: Sequence[float] = (),
    cuff_mmhg: tuple[float, float] = (120.0, 80.0),
) -> calibration.Calibration:
    """Fit one calibration to a table or a run of raw measurements.

    Parameters
    ----------
    kind
        ``force``, ``taxels``, ``gravity``, ``tare``, ``tool``, ``axes``, ``surface``,
        ``latency``, ``compliance``, ``tissue`` or ``heart``; ``palpate calibrate KIND``
        says how to measure for each and which columns its table has.
    measurements
        A CSV table, or a run file.
    device
        The device's name as in the rig file; a run knows it.
    station
        Of a run: the press to take, counted from 1.
    surface_model
        Of a surface: its shape; ``map`` is made of more points.
    scene
        Of a tissue: its block and finger, as a `Scene`, a built-in name or a file.
    relaxation_s
        Of a tissue: a guess of each relaxation time that is wanted [s].
    cuff_mmhg
        Of a heart: the systolic and diastolic reading of a cuff [mmHg].

    Returns
    -------
    Calibration
        Its methods apply it, its ``fit`` has values and 95 % intervals. `record` and `save`
        keep it in a file that a rig can name.

    Raises
    ------
    CalibrationError
        Names file and column, or says what the data leave open.

    Examples
    --------
    >>> import palpate
    >>> fitted = palpate.calibrate("force", "loads.csv", device="cell")
    >>> fitted.fit.names
    ('offset of channel 0', 'sensitivity[0] of channel 0')
    >>> isinstance(fitted, palpate.Calibration)
    True
    """
    if kind not in COLUMNS:
        raise CalibrationError(f"kind = {kind!r}: allowed are {', '.join(COLUMNS)}")
    chosen = Choices(surface_model, as_scene(scene), tuple(relaxation_s), cuff_mmhg)
    taken = read(Path(measurements), kind, device, station)
    for note in taken.notes:
        warnings.warn(f"{taken.path}: {note}", stacklevel=2)
    return fit_measurements(kind, taken, chosen)


def fit_measurements(
    kind: str, measured: Measurements, choices: Choices
) -> calibration.Calibration:
    """The calibration of ``kind``. Raises `CalibrationError` naming file and column, or what the
    readings leave open."""
    try:
        return _fitted(kind, measured, choices)
    except CalibrationError as error:
        where = str(measured.path)
        raise (
            error if str(error).startswith(where) else CalibrationError(f"{where}: {error}")
        ) from None


def _fitted(kind: str, measured: Measurements, choices: Choices) -> calibration.Calibration:
    check_units(kind, measured)
    if kind == "tissue":
        return _tissue(measured, choices)
    arguments = _arguments(kind, measured)
    if kind == "surface":
        return calibration.fit_surface(arguments[0], choices.surface_model)
    if kind == "heart":
        wave = "pressure" in measured.table
        return calibration.fit_heart(
            arguments[0], arguments[1], choices.cuff_mmhg, is_pressure=wave
        )
    fit: Callable[..., calibration.Calibration] = getattr(calibration, f"fit_{kind}")
    return fit(*arguments)


def low_pass_found(measured: Measurements) -> str | None:
    """What the readings of a latency say of the sensor's own low pass, in words; None of none."""
    with suppress(CalibrationError):  # the latency's own fit says what is wrong with them
        if (found := fit_low_pass(*_arguments("latency", measured))) is not None:
            low_s, high_s = found.interval_s
            return (
                f"{measured.device or 'the sensor'} has a low pass of its own of "
                f"{found.filter_s:.3g} s (95 %: {low_s:.3g} to {high_s:.3g}): say filter_s = "
                f"{high_s:.2g} in its [[sensor]], so that the force limit looks behind it. The "
                f"delay that is written includes it; alone it is {1e3 * found.delay_s:.0f} ms"
            )
    return None


def check_drift(file: Path, kind: str, measured: Measurements) -> str | None:
    """Whether the calibration in ``file`` still holds for new readings, by an F test, in words;
    None if there is none, or if its kind cannot be checked so.

    Raises `CalibrationError` where the file's is of another kind, device or number of channels.
    """
    if not file.is_file():
        return None
    one = calibration.load(file)
    if one.kind != kind or (measured.device and one.device != measured.device):
        raise CalibrationError(
            f"{file}: holds a calibration of {one.kind} of {one.device!r}; give another --out"
        )
    old = calibration.restore(one, str(file))
    misses = getattr(old, "misses", None)
    if misses is None:
        return None
    arguments = _arguments(kind, measured)
    _need_as_many(file, old, measured.path, arguments)
    worn = calibration.worse_than(one, misses(*arguments))
    if worn is not None:
        return worn.removesuffix(": calibrate again")
    return (
        f"{kind} calibration of {one.device}: it still holds, readings miss it by no more than its "
        "residuals allow (F test)"
    )


def _need_as_many(
    file: Path, old: calibration.Calibration, table: Path, arguments: tuple[Array, ...]
) -> None:
    """Readings of another number of channels are another sensor's, or it was changed: neither says
    whether the calibration in ``file`` holds, nor may take its place without a word."""
    match old:
        case calibration.ForceCalibration():
            channels, loads = old.sensitivity.shape
            has, what = f"{channels} x {loads}", "channels x loads"
            new = f"{arguments[0].shape[1]} x {arguments[1].shape[1]}"
        case calibration.TaxelCalibration():
            has, new, what = str(len(old.gain)), str(arguments[0].shape[1]), "taxels"
        case _:
            return
    if has != new:
        raise CalibrationError(
            f"{file}: holds a calibration of {has} {what}, {table} has readings of {new}: whether "
            "it still holds cannot be said. Give another --out, or move the file"
        )


def _arguments(kind: str, measured: Measurements) -> tuple[Array, ...]:
    """What `calibration`'s functions of ``kind`` take, SI."""
    match kind:
        case "force":
            warm = (measured.column("temperature_c"),) if "temperature_c" in measured.table else ()
            return measured.numbered("raw"), measured.numbered("load", "_n"), *warm
        case "taxels":
            return measured.numbered("raw"), measured.column("pressure_pa")
        case "gravity":
            return measured.columns("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"), _turns(
                measured
            )
        case "tare":
            return measured.column("time_s"), measured.numbered("value")
        case "tool":
            return 1e-3 * measured.columns("x_mm", "y_mm", "z_mm"), _turns(measured)
        case "axes":
            true = measured.columns("true_x_mm", "true_y_mm", "true_z_mm")
            return 1e-3 * measured.columns("x_mm", "y_mm", "z_mm"), 1e-3 * true
        case "surface":
            return (1e-3 * measured.columns("x_mm", "y_mm", "z_mm"),)
        case "latency":
            stage = measured.filled("time_s", "depth_mm")
            sensor = measured.filled("sensor_time_s", "force_n")
            return stage[:, 0], 1e-3 * stage[:, 1], sensor[:, 0], sensor[:, 1]
        case "heart":
            beats = measured.columns(
                "time_s", "pressure" if "pressure" in measured.table else "reference"
            )
            return beats[:, 0], beats[:, 1]
        case _:
            curve = measured.columns("depth_mm", "force_n")
            return 1e-3 * curve[:, 0], curve[:, 1]


def _turns(measured: Measurements) -> Array:
    return Rotation.from_rotvec(measured.columns("rx_rad", "ry_rad", "rz_rad")).as_matrix()


def _tissue(measured: Measurements, choices: Choices) -> calibration.TissueCalibration:
    scene = choices.scene
    if scene is None or scene.tissue is None:
        raise CalibrationError("a scene with a block of tissue is needed: TI or one of your own")
    names = ("depth_mm", "force_n", *(("time_s",) if "time_s" in measured.table else ()))
    columns = measured.columns(*names)
    if "held" in measured.table and not choices.relaxation_s:
        columns = columns[measured.column("held") == 0]  # a hold is of use to relaxation only
    depth, force = 1e-3 * columns[:, 0], columns[:, 1]
    with suppress(CalibrationError):  # without readings in the air depths are taken as they are
        depth = depth - float(find_contact(depth, force).values[0])
    plain = scene.model_copy(update={"inclusion": ()})
    at_mm = float(np.median(measured.column("x_mm"))) if "x_mm" in measured.table else None
    deepest_m, half_m = float(depth.max()), HALF * 1e-3 * scene.tissue.height_mm
    while True:
        forward, off = force_of_modulus(plain, deepest_m, x_mm=at_mm)
        fitted = calibration.fit_tissue(
            depth, force, forward, [1e3 * scene.tissue.modulus_kpa],
            time_s=columns[:, 2] if len(names) == 3 else None,
            relaxation_start_s=choices.relaxation_s, forward_off=off,
        )  # fmt: skip
        reached_m = float(depth.max()) - fitted.surface_m
        if reached_m <= KNOWN * deepest_m:
            return fitted
        if reached_m >= half_m:
            raise CalibrationError(
                f"the force would begin {1e3 * reached_m:.3g} mm above the deepest reading; "
                f"{1e3 * half_m:.3g}, half of the block, are believed: check force_n, depth_mm and "
                "the scene, and begin the press in the air"
            )
        deepest_m = reached_m


def raw_columns(measured: Measurements) -> dict[str, Array]:
    """Every column, for the file."""
    return {str(name): measured.filled(str(name))[:, 0] for name in measured.table}
