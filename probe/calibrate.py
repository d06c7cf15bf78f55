"""Calibrations from tables of readings: which columns each needs, and the tissue's by the phantom.

The fits themselves are in `calibration` and know neither files nor finite elements.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from calibration import (
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
)
from calibration.errors import CalibrationError
from sim_backend.press import press
from sim_backend.scene import Scene, load_scene

Array = NDArray[np.float64]
Raw = dict[str, Array]

MAX_ROWS = 5_000_000
CURVE_POINTS = 9
DEFAULT_CUFF_MMHG = (120.0, 80.0)


@dataclass(frozen=True)
class Readings:
    """A table's columns; asking for one that is not there says which file and what it has."""

    path: Path
    table: pd.DataFrame

    def column(self, name: str) -> Array:
        """(n,) of one column, without empty cells."""
        if name not in self.table:
            raise CalibrationError(f"{self.path}: column {name} is missing; it has "
                                   f"{', '.join(map(str, self.table))}")  # fmt: skip
        values = pd.to_numeric(self.table[name], errors="coerce").to_numpy(float)
        return np.asarray(values[np.isfinite(values)])

    def columns(self, *names: str) -> Array:
        """(n, k)."""
        return np.column_stack([self.column(name) for name in names])

    def numbered(self, name: str, unit: str = "") -> Array:
        """``name`` + unit, or ``name_0``, ``name_1``, … with it: (n, k)."""
        if name + unit in self.table:
            return self.column(name + unit)[:, None]
        many = [c for n in range(4096) if (c := f"{name}_{n}{unit}") in self.table]
        return self.columns(*many) if many else self.columns(name + unit)


def read(path: Path) -> Readings:
    """A CSV table of numbers. Raises `CalibrationError`."""
    if not path.is_file():
        raise CalibrationError(f"{path}: no such file")
    try:
        table = pd.read_csv(path, nrows=MAX_ROWS, comment="#")
    except (ValueError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path}: not a CSV table ({error})") from None
    return Readings(path, table.rename(columns=str.strip))


def fit_table(
    kind: str, path: Path, *, surface_model: Any = "plane", scene_name: str = "TI",
    twin: Path | None = None,
) -> tuple[Any, Raw]:  # fmt: skip
    """The calibration of ``kind`` from the table in ``path``, and the columns it was made from.

    Raises `CalibrationError` naming file and column, or what the readings leave open.
    """
    r = read(path)
    raw = {str(c): r.column(str(c)) for c in r.table}
    if kind == "tissue":
        return _tissue(r, load_scene(scene_name), twin), raw
    fits: dict[str, Callable[[], Any]] = {
        "force": lambda: fit_force(r.numbered("raw"), r.numbered("load", "_n"),
                                   r.column("temperature_c") if "temperature_c" in raw else None),
        "taxels": lambda: fit_taxels(r.numbered("raw"), r.column("pressure_pa")),
        "gravity": lambda: fit_gravity(
            r.columns("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"), _turns(r)
        ),
        "tare": lambda: fit_tare(r.column("time_s"), r.numbered("value")),
        "tool": lambda: fit_tool(1e-3 * r.columns("x_mm", "y_mm", "z_mm"), _turns(r)),
        "axes": lambda: fit_axes(1e-3 * r.columns("x_mm", "y_mm", "z_mm"),
                                 1e-3 * r.columns("true_x_mm", "true_y_mm", "true_z_mm")),
        "surface": lambda: fit_surface(1e-3 * r.columns("x_mm", "y_mm", "z_mm"), surface_model),
        "latency": lambda: fit_latency(r.column("time_s"), 1e-3 * r.column("depth_mm"),
                                       r.column("sensor_time_s"), r.column("force_n")),
        "compliance": lambda: fit_compliance(1e-3 * r.column("depth_mm"), r.column("force_n")),
        "heart": lambda: fit_heart(r.column("time_s"), r.column("reference"), DEFAULT_CUFF_MMHG,
                                   is_pressure=False),
    }  # fmt: skip
    return fits[kind](), raw


def _turns(r: Readings) -> Array:
    return Rotation.from_rotvec(r.columns("rx_rad", "ry_rad", "rz_rad")).as_matrix()


def _tissue(r: Readings, scene: Scene, twin: Path | None) -> Any:
    if scene.tissue is None:
        raise CalibrationError(f"scene {scene.name}: it has no tissue; take TI or one of your own")
    depth = 1e-3 * r.column("depth_mm")
    plain = scene.model_copy(update={"inclusion": ()})
    forward = force_of_modulus(plain, float(depth.max()))
    start_pa = 1e3 * scene.tissue.modulus_kpa
    found = fit_tissue(depth, r.column("force_n"), forward, [start_pa])
    if twin is not None:
        write_twin(plain, float(found.modulus_pa[0]), twin)
    return found


def force_of_modulus(
    scene: Scene, deepest_m: float
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Force (n,) [N] of moduli (1,) [Pa] and depths (n,) [m] on plain tissue, with its derivative
    (n, 1), by finite strain: a neo-Hookean block's force is proportional to its modulus."""
    if scene.tissue is None:
        raise CalibrationError(f"scene {scene.name} has no tissue")
    depths = np.linspace(0.0, 1.1 * deepest_m, CURVE_POINTS)
    x_mm = 0.5 * scene.tissue.width_mm
    force = [0.0] + [
        scene.indenter.length_mm
        * press(scene, x_mm, 1e3 * d, model="finite", accuracy_pct=0.5).states[0].force_n_per_mm
        for d in depths[1:]
    ]
    per_pa = PchipInterpolator(depths, np.array(force) / (1e3 * scene.tissue.modulus_kpa))

    def forward(moduli: Array, depth_m: Array) -> tuple[Array, Array]:
        unit = np.where(depth_m > 0, per_pa(np.clip(depth_m, 0.0, depths[-1])), 0.0)
        return moduli[0] * unit, unit[:, None]

    return forward


def write_twin(scene: Scene, modulus_pa: float, path: Path) -> None:
    """The scene with the modulus found, as a file: the digital twin of the block on the table."""
    tissue, finger = scene.tissue, scene.indenter.model_dump(exclude_none=True)
    assert tissue is not None
    lines = [f'name = "{path.stem}"', f'plane = "{scene.plane}"', "", "[tissue]"]
    block = tissue.model_dump() | {"modulus_kpa": round(1e-3 * modulus_pa, 4)}
    lines += [f"{k} = {v}" for k, v in block.items() if k != "relaxation"]
    lines += ["", "[indenter]"]
    lines += [f"{k} = {_toml(v)}" for k, v in finger.items()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)
