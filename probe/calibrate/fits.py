"""Calibrations from readings: which columns each needs, and the tissue's by the phantom.

The fits themselves are in `calibration` and know neither files nor finite elements.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from calibration import (
    Calibration,
    TissueCalibration,
    fit_axes,
    fit_compliance,
    fit_force,
    fit_gravity,
    fit_heart,
    fit_latency,
    fit_surface,
    fit_tare,
    fit_taxels,
    fit_tissue,
    fit_tool,
    load,
    restore,
    worse_than,
)
from calibration.errors import CalibrationError
from calibration.touch import find_contact
from probe.calibrate.measurements import Measurements, read
from sim_backend.scene.scene_file import Scene, as_scene

Array = NDArray[np.float64]
Forward = Callable[[Array, Array], tuple[Array, Array]]

CURVE_POINTS = 11
KINDS = (
    "force", "taxels", "gravity", "tare", "tool", "axes", "surface", "latency", "compliance",
    "tissue", "heart",
)  # fmt: skip


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
) -> Calibration:
    """Fit one calibration to a table or a run of raw measurements.

    Parameters
    ----------
    kind : ``force``, ``taxels``, ``gravity``, ``tare``, ``tool``, ``axes``, ``surface``,
        ``latency``, ``compliance``, ``tissue`` or ``heart``; ``palpate calibrate KIND`` says how
        to measure for each and which columns its table has.
    measurements : a CSV table, or a run file.
    device : the device's name as in the rig file; a run knows it.
    station : of a run, the press to take, from 0.
    scene : of a tissue, its block and finger: a `Scene`, a built-in name or a file.
    relaxation_s : of a tissue, a guess of each relaxation time that is wanted [s].
    cuff_mmhg : of a heart, the systolic and diastolic reading of a cuff.

    Returns
    -------
    The fitted calibration: its methods apply it, its ``fit`` has values and 95 % intervals.
    `calibration.record` and `calibration.save` keep it in a file that a rig can name.

    Raises
    ------
    CalibrationError : names file and column, or says what the data leave open.
    """
    if kind not in KINDS:
        raise CalibrationError(f"kind = {kind!r}: allowed are {', '.join(KINDS)}")
    chosen = Choices(surface_model, as_scene(scene), tuple(relaxation_s), cuff_mmhg)
    return fit_measurements(kind, read(Path(measurements), kind, device, station), chosen)


def fit_measurements(kind: str, r: Measurements, choices: Choices) -> Calibration:
    """The calibration of ``kind``. Raises `CalibrationError` naming file and column, or what the
    readings leave open."""
    if kind == "tissue":
        return _tissue(r, choices)
    arguments = _arguments(kind, r)
    if kind == "surface":
        return fit_surface(arguments[0], choices.surface_model)
    if kind == "heart":
        wave = "pressure" in r.table
        return fit_heart(arguments[0], arguments[1], choices.cuff_mmhg, is_pressure=wave)
    fits: dict[str, Callable[..., Calibration]] = {
        "force": fit_force, "taxels": fit_taxels, "gravity": fit_gravity, "tare": fit_tare,
        "tool": fit_tool, "axes": fit_axes, "latency": fit_latency, "compliance": fit_compliance,
    }  # fmt: skip
    return fits[kind](*arguments)


def check_drift(file: Path, kind: str, r: Measurements) -> str | None:
    """A warning if the calibration in ``file`` misses new readings by more than its residuals
    allow; None if it holds, if there is none, or if its kind cannot be told so."""
    if not file.is_file():
        return None
    one = load(file)
    if one.kind != kind or (r.device and one.device != r.device):
        raise CalibrationError(
            f"{file}: holds a calibration of {one.kind} of {one.device!r}; give another --out"
        )
    misses = getattr(restore(one, str(file)), "misses", None)
    return None if misses is None else worse_than(one, misses(*_arguments(kind, r)))


def _arguments(kind: str, r: Measurements) -> tuple[Array, ...]:
    """What `calibration`'s functions of ``kind`` take, SI."""
    match kind:
        case "force":
            warm = (r.column("temperature_c"),) if "temperature_c" in r.table else ()
            return r.numbered("raw"), r.numbered("load", "_n"), *warm
        case "taxels":
            return r.numbered("raw"), r.column("pressure_pa")
        case "gravity":
            return r.columns("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"), _turns(r)
        case "tare":
            return r.column("time_s"), r.numbered("value")
        case "tool":
            return 1e-3 * r.columns("x_mm", "y_mm", "z_mm"), _turns(r)
        case "axes":
            true = r.columns("true_x_mm", "true_y_mm", "true_z_mm")
            return 1e-3 * r.columns("x_mm", "y_mm", "z_mm"), 1e-3 * true
        case "surface":
            return (1e-3 * r.columns("x_mm", "y_mm", "z_mm"),)
        case "latency":
            stage = r.columns("time_s", "depth_mm")
            sensor = r.columns("sensor_time_s", "force_n")
            return stage[:, 0], 1e-3 * stage[:, 1], sensor[:, 0], sensor[:, 1]
        case "heart":
            felt = r.columns("time_s", "pressure" if "pressure" in r.table else "reference")
            return felt[:, 0], felt[:, 1]
        case _:
            curve = r.columns("depth_mm", "force_n")
            return 1e-3 * curve[:, 0], curve[:, 1]


def _turns(r: Measurements) -> Array:
    return Rotation.from_rotvec(r.columns("rx_rad", "ry_rad", "rz_rad")).as_matrix()


def _tissue(r: Measurements, choices: Choices) -> TissueCalibration:
    scene = choices.scene
    if scene is None or scene.tissue is None:
        raise CalibrationError("a scene with a block of tissue is needed: TI or one of your own")
    names = ("depth_mm", "force_n", *(("time_s",) if "time_s" in r.table else ()))
    columns = r.columns(*names)
    if "held" in r.table and not choices.relaxation_s:
        columns = columns[r.column("held") == 0]  # a hold is of use to relaxation only
    depth, force = 1e-3 * columns[:, 0], columns[:, 1]
    with suppress(CalibrationError):  # without readings in the air depths are taken as they are
        depth = depth - float(find_contact(depth, force).values[0])
    plain = scene.model_copy(update={"inclusion": ()})
    at_mm = float(np.median(r.column("x_mm"))) if "x_mm" in r.table else None
    forward = force_of_modulus(plain, float(depth.max()), x_mm=at_mm)
    return fit_tissue(
        depth, force, forward, [1e3 * scene.tissue.modulus_kpa],
        time_s=columns[:, 2] if len(names) == 3 else None,
        relaxation_start_s=choices.relaxation_s,
    )  # fmt: skip


def force_of_modulus(
    scene: Scene, deepest_m: float, model: str | None = None, x_mm: float | None = None
) -> Forward:
    """Force (n,) [N] of moduli (1,) [Pa] and depths (n,) [m] on plain tissue, with its derivative
    (n, 1), by the finite elements: a homogeneous block's force is proportional to its modulus.
    Pressed at ``x_mm`` of the block, by default in its middle. A solid's block under a round finger
    is solved as a body of revolution."""
    from sim_backend.fem.axisymmetric import is_round  # finite elements: for nothing else here
    from sim_backend.models.press import press

    if scene.tissue is None:
        raise CalibrationError(f"scene {scene.name} has no tissue")
    depths = 1.1 * deepest_m * np.linspace(0.0, 1.0, CURVE_POINTS)[1:] ** 1.5
    width_mm = scene.tissue.width_mm
    x_mm = 0.5 * width_mm if x_mm is None else x_mm
    if not 0 < x_mm < width_mm:
        raise CalibrationError(f"pressed at x = {x_mm:g} mm; the scene's block is {width_mm:g} mm "
                               "wide, from 0")  # fmt: skip
    round_one = is_round(scene, x_mm)
    solid = scene.plane == "solid"
    model = model or ("axisymmetric" if round_one else "solid" if solid else "finite")
    accuracy_pct = 3.0 if solid and not round_one else 0.2
    force = [
        press(scene, x_mm, 1e3 * d, model=model, accuracy_pct=accuracy_pct).states[0].force_n
        for d in depths
    ]
    return proportional(depths, np.array(force) / (1e3 * scene.tissue.modulus_kpa))


def proportional(depths: Array, force_per_pa: Array) -> Forward:
    """The forward model through forces per modulus (k,) at ``depths`` (k,) > 0, none in the air.

    The force over the depth is interpolated: it varies little.
    """
    slope = CubicSpline(depths, force_per_pa / depths)

    def forward(moduli: Array, depth_m: Array) -> tuple[Array, Array]:
        sunk = np.clip(depth_m, 0.0, depths[-1])
        unit = sunk * slope(np.maximum(sunk, depths[0]))
        return moduli[0] * unit, unit[:, None]

    return forward


def raw_columns(r: Measurements) -> dict[str, Array]:
    """Every column, for the file."""
    return {str(name): r.column(str(name)) for name in r.table}
