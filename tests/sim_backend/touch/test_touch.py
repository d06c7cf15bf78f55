"""`palpate.touch` against presses of the finite elements, and what it imports."""

import subprocess
import sys

import numpy as np
import pytest

import palpate


@pytest.mark.parametrize(
    ("name", "x_mm", "depth_mm", "pressure_mmhg"),
    [
        ("TI", 20.0, 2.0, None), ("TIT", 32.0, 2.5, None), ("TIT", 27.0, 1.3, None),
        ("TIHA", 32.0, 2.5, 120.0), ("TIHA", 36.0, 1.5, 80.0), ("TISA", 30.0, 2.2, 100.0),
    ],
)  # fmt: skip
def test_a_force_is_that_of_the_finite_elements(
    name: str, x_mm: float, depth_mm: float, pressure_mmhg: float | None
) -> None:
    felt = palpate.touch(name)
    pressures = None if pressure_mmhg is None else [pressure_mmhg]
    true_n = palpate.press(name, x_mm, depth_mm, pressures_mmhg=pressures).states[0].force_n
    force_n = float(felt.force_n(x_mm, depth_mm, pressure_mmhg))
    error_n = float(felt.error_n(x_mm, depth_mm, pressure_mmhg))
    assert abs(force_n - true_n) < 3 * error_n + 0.006 * true_n
    assert error_n < 0.02 * true_n


def test_another_block_and_finger_are_known_too() -> None:
    scene = palpate.load_scene("TIT")
    lump = scene.inclusion[0]
    assert scene.tissue is not None
    scene = scene.model_copy(update={
        "tissue": scene.tissue.model_copy(update={"height_mm": 14.0, "modulus_kpa": 20.0}),
        "inclusion": (lump.model_copy(update={"depth_mm": 8.0}),),
        "indenter": scene.indenter.model_copy(update={"radius_mm": 4.0}),
    })  # fmt: skip
    true_n = palpate.press(scene, 30.0, 1.8).states[0].force_n
    assert float(palpate.touch(scene).force_n(30.0, 1.8)) == pytest.approx(true_n, rel=0.02)


def test_states_are_broadcast_and_none_is_another_s() -> None:
    felt = palpate.touch("TIHA")
    x, depth, pressure = np.linspace(20, 40, 5), np.array([[1.0], [2.0]]), 95.0
    both = felt.force_n(x, depth, pressure)
    assert both.shape == (2, 5)
    np.testing.assert_allclose(both[1, 3], felt.force_n(x[3], 2.0, pressure), rtol=1e-12)
    many = felt.force_n(np.tile(x, 2000), 1.0, pressure)
    np.testing.assert_allclose(many.reshape(-1, 5), np.tile(both[0], (2000, 1)), rtol=1e-12)


def test_a_finger_in_the_air_feels_nothing_and_a_deeper_one_more() -> None:
    felt = palpate.touch("TIHA")
    force = felt.force_n(30.0, np.linspace(0.0, 2.5, 60))
    assert force[0] == 0 and (np.diff(force) > 0).all()


@pytest.mark.parametrize(
    ("state", "said"),
    [
        ((32.0, 2.6), "depth_mm: the touch table knows 0 to 2.5 mm"),
        ((65.0, 1.0), "x_mm: the touch table knows 0 to 64 mm"),
        ((32.0, 1.0, 150.0), "pressure_mmhg: the touch table knows 80 to 120 mmHg"),
        ((np.nan, 1.0), "x_mm"),
    ],
)
def test_what_the_table_does_not_know_is_refused(state: tuple[float, ...], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        palpate.touch("TIHA").force_n(*state)


def test_a_scene_without_a_table_is_refused() -> None:
    for scene, said in (("TIT-solid", "no touch table"), ("HAOT", "no touch table")):
        with pytest.raises(palpate.SceneError, match=said):
            palpate.touch(scene)


def test_it_imports_neither_rig_nor_window_nor_finite_elements() -> None:
    code = (
        "import palpate, sys; palpate.touch('TIT').force_n(32, 2);"
        "print([m for m in sys.modules if m.startswith(('probe', 'scipy', 'sim_backend.fem',"
        "'sim_backend.models', 'PySide6', 'pyqtgraph'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
