"""Tables whose numbers are not in the units that their columns name are refused, not fitted."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from calibration.errors import CalibrationError
from probe.calibrate.fits import Choices, fit_measurements
from probe.calibrate.measurements import Measurements, read
from sim_backend.scene.scene_file import load_scene

RNG = np.random.default_rng(5)
N = 40
POINTS_MM = RNG.uniform(0.0, 100.0, (N, 3))
DEPTHS_MM = np.linspace(-0.2, 0.5, N)
LOADS_N = np.tile([0.0, 1.0, 2.0, 5.0], N // 4)
PRESSURES_PA = np.tile([0.0, 1e3, 5e3, 2e4], N // 4)
TURNS_RAD = Rotation.random(N, random_state=3).as_rotvec()
SPAN_S = np.arange(0.0, 20.0, 0.01)
TAPS_MM = np.interp(SPAN_S, np.arange(0.0, 20.0, 0.37), RNG.uniform(0.0, 1.0, 55))


def noisy(values: np.ndarray, sd: float = 1e-3) -> np.ndarray:
    return values + sd * RNG.standard_normal(values.shape)


def of_points(*names: str, mm: np.ndarray = POINTS_MM) -> dict[str, np.ndarray]:
    return dict(zip(names, mm.T, strict=True))


WRENCH = np.column_stack([
    noisy(Rotation.from_rotvec(TURNS_RAD).inv().apply([0.0, 0.0, -4.0])),
    noisy(np.cross([0.01, 0.02, 0.05],
                   Rotation.from_rotvec(TURNS_RAD).inv().apply([0.0, 0.0, -4.0])), 1e-4),
])  # fmt: skip
TILTED = Rotation.from_rotvec(RNG.uniform(-0.5, 0.5, (N, 3)))
TABLES: dict[str, dict[str, np.ndarray]] = {
    "force": {"raw": noisy(1.3 * LOADS_N + 0.2), "load_n": LOADS_N},
    "taxels": {"raw_0": noisy(1e-3 * PRESSURES_PA), "pressure_pa": PRESSURES_PA},
    "gravity": of_points("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm", mm=WRENCH)
    | of_points("rx_rad", "ry_rad", "rz_rad", mm=TURNS_RAD),
    "tool": of_points("x_mm", "y_mm", "z_mm", mm=noisy(-TILTED.apply([2.0, 3.0, 120.0])))
    | of_points("rx_rad", "ry_rad", "rz_rad", mm=TILTED.as_rotvec()),
    "axes": of_points("x_mm", "y_mm", "z_mm")
    | of_points("true_x_mm", "true_y_mm", "true_z_mm", mm=noisy(1.01 * POINTS_MM)),
    "surface": of_points("x_mm", "y_mm", "z_mm",
                         mm=np.column_stack([POINTS_MM[:, :2], noisy(0.02 * POINTS_MM[:, 0])])),
    "compliance": {"depth_mm": DEPTHS_MM, "force_n": noisy(8 * np.maximum(DEPTHS_MM, 0.0))},
    "latency": {"time_s": SPAN_S, "depth_mm": TAPS_MM, "sensor_time_s": SPAN_S,
                "force_n": noisy(np.interp(SPAN_S - 0.012, SPAN_S, TAPS_MM))},
}  # fmt: skip

MISTAKES: list[tuple[str, str, float, str]] = [
    ("force", "load_n", 1e3, r"load_n: 5e\+03 N"),
    ("force", "load_n", 1e-3, r"load_n: 0\.005 N between"),
    ("taxels", "pressure_pa", 1e-3, "pressure_pa: 20 Pa between .*; 200 to 1e"),
    ("gravity", "f", 1e3, "fx_n, fy_n, fz_n: .* N between"),
    ("gravity", "m", 1e3, "mx_nm, my_nm, mz_nm: .* Nm between"),
    ("gravity", "r", 57.3, "longer than a full turn; are they in degrees"),
    ("tool", "r", 57.3, "longer than a full turn; are they in degrees"),
    ("tool", "xyz", 1e-3, "x_mm, y_mm, z_mm: .* mm between"),
    ("axes", "true", 1e-3, "true_x_mm, true_y_mm, true_z_mm: .* mm between"),
    ("axes", "true", 4.0, r"4\.04 to 4\.04 times as far as it reads"),
    ("axes", "true", 0.25, r"0\.252 to 0\.253 times as far as it reads"),
    ("surface", "xy", 1e-3, "x_mm, y_mm: .* mm between"),
    ("surface", "z", 1e3, "rises by 20 m per metre"),
    ("compliance", "depth", 1e-3, r"column depth_mm: 0\.0007 mm between"),
    ("compliance", "depth", 1e3, "column depth_mm: 700 mm between"),
    ("compliance", "force", 1e3, r"column force_n: 4e\+03 N between"),
    ("latency", "time_s", 1e3, "column time_s: a sample every 10 s"),
    ("latency", "sensor", 1e3, "column sensor_time_s: a sample every 10 s"),
]


def fit(kind: str, table: dict[str, np.ndarray]) -> object:
    measured = Measurements(Path("t.csv"), pd.DataFrame(table), "d")
    return fit_measurements(kind, measured, Choices())


@pytest.mark.parametrize("kind", TABLES)
def test_what_is_in_its_units_is_fitted(kind: str) -> None:
    assert fit(kind, TABLES[kind])


@pytest.mark.parametrize(("kind", "which", "factor", "reported"), MISTAKES)
def test_another_unit_is_refused_with_what_is_possible(
    kind: str, which: str, factor: float, reported: str
) -> None:
    begins: tuple[str, ...] = tuple(which) if which in ("xyz", "xy") else (which,)
    table = {name: factor * column if name.startswith(begins) else column
             for name, column in TABLES[kind].items()}  # fmt: skip
    with pytest.raises(CalibrationError, match=f"t.csv: .*{reported}"):
        fit(kind, table)


def pressed(
    begins_mm: float, force_n: Callable[[np.ndarray], np.ndarray], height_mm: float = 16.83
) -> object:
    """A tissue's table whose depths count from ``begins_mm`` below its surface."""
    scene = load_scene("TI")
    assert scene.tissue is not None
    tissue = scene.tissue.model_copy(update={"height_mm": height_mm})
    scene = scene.model_copy(update={"tissue": tissue})
    depth = np.linspace(0.0, 1.0, N)
    table = {"depth_mm": depth, "force_n": noisy(force_n(depth + begins_mm), 1e-4)}
    measured = Measurements(Path("t.csv"), pd.DataFrame(table), "d")
    return fit_measurements("tissue", measured, Choices(scene=scene))


def test_a_press_that_begins_in_contact_is_fitted_as_deep_as_it_goes() -> None:
    """The force was known to 1.1 times the deepest reading only, and stood still below."""
    from probe.calibrate.tissue_force import force_of_modulus

    truth, _ = force_of_modulus(load_scene("TI"), 2.5e-3)
    found = pressed(1.2, lambda mm: truth(np.array([30e3]), 1e-3 * mm)[0])
    assert found.modulus_pa[0] == pytest.approx(30e3, rel=0.01)  # type: ignore[attr-defined]
    assert 1e3 * found.surface_m == pytest.approx(-1.2, abs=0.02)  # type: ignore[attr-defined]


def test_a_force_that_does_not_rise_is_no_tissue() -> None:
    with pytest.raises(CalibrationError, match="does not rise with depth"):
        pressed(0.0, lambda mm: np.linspace(1.0, 0.9999, len(mm)))
    with pytest.raises(CalibrationError, match=r"would begin .* mm above the deepest reading"):
        pressed(0.0, lambda mm: 1.0 + 0.01 * mm)


@pytest.mark.parametrize("text, reported", [
    ("raw;load_n\n0,2;1\n0,4;2\n", "separated by semicolons; save it with commas"),
    ("raw,load_n\n0.2,1\ninf,2\n", "column raw, row 2: 'inf' is not a number"),
    ("time_s,value\n" + "".join(f"{n},1\n" for n in range(20)), "the readings never change"),
])  # fmt: skip
def test_a_table_says_what_is_wrong_with_it(tmp_path: Path, text: str, reported: str) -> None:
    file = tmp_path / "t.csv"
    file.write_text(text)
    kind = "tare" if text.startswith("time_s") else "force"
    with pytest.raises(CalibrationError, match=reported):
        fit_measurements(kind, read(file, kind, "d"), Choices())


def test_a_press_past_half_of_its_block_is_fitted_where_it_begins_in_the_air() -> None:
    from probe.calibrate.tissue_force import force_of_modulus

    scene = load_scene("TI")
    assert scene.tissue is not None
    thin = scene.tissue.model_copy(update={"height_mm": 1.9})
    truth, _ = force_of_modulus(scene.model_copy(update={"tissue": thin}), 1e-3)
    found = pressed(0.0, lambda mm: truth(np.array([30e3]), 1e-3 * mm)[0], 1.9)
    assert found.modulus_pa[0] == pytest.approx(30e3, rel=0.01)  # type: ignore[attr-defined]
