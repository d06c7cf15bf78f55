"""`palpate.touch` and its tables against presses of the finite elements."""

from pathlib import Path

import numpy as np
import pytest
from changed_scene import changed
from programs import python

import palpate
from sim_backend.arrays import Array
from sim_backend.models.train_touch import SUNK, at_depths, random_press, sample, touch_table
from sim_backend.touch import kept
from sim_backend.touch.basis import Basis
from sim_backend.touch.bodies import Units
from sim_backend.touch.kept import table_for
from sim_backend.touch.kinds import LUMP, VESSEL
from sim_backend.touch.table import TouchTable, block_of


@pytest.mark.parametrize("name, x_mm, depth_mm, pressure_mmhg", [
    ("TI", 20.0, 2.0, None), ("TIT", 32.0, 2.5, None), ("TIT", 27.0, 1.3, None),
    ("TIHA", 32.0, 2.5, 120.0), ("TIHA", 36.0, 1.5, 80.0), ("TISA", 30.0, 2.2, 100.0),
])  # fmt: skip
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
    scene = changed("TIT", tissue={"height_mm": 14.0, "modulus_kpa": 20.0},
                    inclusion={"depth_mm": 8.0}, indenter={"radius_mm": 4.0})  # fmt: skip
    true_n = palpate.press(scene, 30.0, 1.8).states[0].force_n
    assert float(palpate.touch(scene).force_n(30.0, 1.8)) == pytest.approx(true_n, rel=0.02)


@pytest.mark.parametrize("name", ["TIT", "TIHA"])
def test_what_is_read_between_the_points_of_a_grid_is_the_table_s(name: str) -> None:
    scene = palpate.load_scene(name)
    table, (kind, theta) = table_for(scene), Units(scene).parameters(scene.inclusion[0])
    assert table is not None
    x_mm, depth_mm = np.random.default_rng(1).uniform([1.0, 0.4], [63.0, 2.4], (400, 2)).T
    x, sunk = x_mm / 5 - 6.4, depth_mm / 5  # of a finger of 5 mm radius over a block of 64 mm
    bump = table.ratios[kind.name](x, sunk, np.tile(theta, (len(x), 1)))[:, 0]
    direct = table.bare_force(x, sunk, block_of(scene)) * (1 + bump)
    read = palpate.touch(scene).force_n(x_mm, depth_mm)
    assert np.ptp(read / direct) < 1e-5 * np.mean(read / direct)


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


@pytest.mark.parametrize("state, said", [
    ((32.0, 2.6), "depth_mm: the touch table knows 0 to 2.5 mm"),
    ((65.0, 1.0), "x_mm: the touch table knows 0 to 64 mm"),
    ((32.0, 1.0, 150.0), "pressure_mmhg: the touch table knows 80 to 120 mmHg"),
    ((np.nan, 1.0), "x_mm"),
])  # fmt: skip
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
    assert python("-c", code, status=0).stdout.strip() == "[]"


R_MM = 5.0


@pytest.fixture(scope="module")
def table() -> TouchTable:
    return table_for(palpate.load_scene("TI"))


def test_a_basis_has_the_symmetry_and_the_weights_that_it_is_given() -> None:
    assert len(Basis(4, (1, 1, 1)).exponents) == 35  # all products of three up to the fourth degree
    basis, at = Basis(4, (1, 2, 1), odd=2), np.array([[0.3, -0.7, 0.2]])
    np.testing.assert_allclose(basis.values(at), basis.values(at * [-1, -1, 1]))
    assert basis.exponents[:, 1].max() == 2


@pytest.mark.parametrize(
    "size_mm", [{}, {"height_mm": 12.0}, {"height_mm": 24.0, "width_mm": 50.0}]
)
@pytest.mark.parametrize(("aside_mm", "depth_mm"), [(0.0, 2.5), (14.0, 1.2)])
def test_a_bare_block_is_that_of_the_finite_elements(
    size_mm: dict[str, float], aside_mm: float, depth_mm: float, table: TouchTable
) -> None:
    scene = changed("TI", tissue=size_mm)
    x_mm = scene.tissue.width_mm / 2 + aside_mm
    pressed = palpate.press(scene, x_mm, depth_mm, accuracy_pct=1)
    unit_n = 50e3 * R_MM * 1e-3 * 10e-3
    at = np.array([aside_mm / R_MM]), np.array([depth_mm / R_MM])
    force_n = unit_n * table.bare_force(*at, block_of(scene))
    assert force_n[0] == pytest.approx(pressed.states[0].force_n, rel=0.01)


def test_many_bodies_at_once_are_each_alone(table: TouchTable) -> None:
    rng = np.random.default_rng(1)
    x, sunk, block = np.array([-2.0, 0.0, 1.5]), np.array([0.2, 0.5]), np.log([3.0, 6.0])
    for kind in (LUMP, VESSEL):
        low, high = np.array(kind.low), np.array(kind.high)
        theta = low + (high - low) * rng.uniform(0.3, 0.7, (4, len(low)))
        theta[:, -2:] = block
        at_once = table.ratios[kind.name].at_depths(sunk, block)(x, theta)
        for m, body in enumerate(theta):
            for n, place in enumerate(x):
                bodies = np.tile(body, (len(sunk), 1))
                alone = table.ratios[kind.name](np.full(len(sunk), place), sunk, bodies)
                np.testing.assert_allclose(at_once[m, n], alone, rtol=1e-9, atol=1e-12)


def test_a_table_is_read_as_it_was_written(table: TouchTable, tmp_path: Path) -> None:
    table.save(tmp_path / "t.npz")
    again = TouchTable.load(tmp_path / "t.npz")
    assert again.about == dict(table.about)
    at = np.array([1.0]), np.array([0.3]), np.log([3.0, 6.0])
    assert again.bare_force(*at) == table.bare_force(*at)
    assert again.ratios.keys() == table.ratios.keys()


def test_a_press_is_trained_on_with_its_exact_slopes() -> None:
    block = palpate.load_scene("TI")
    over, bare = random_press("vessel", block, 3)
    kind, units, step = VESSEL, Units(block), 1e-4
    for name in ("log_ratio", "log_pressure", "swing"):
        along = step * np.eye(len(kind.parameters))[kind.parameters.index(name)]
        ahead, behind = (
            sample(kind, units, over.theta[0] + s * along, over.x[0], 0)[0].value for s in (1, -1)
        )
        slope = over.slope[:, kind.parameters.index(name)]
        np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), rtol=1e-3, atol=1e-5)
    assert np.isfinite(bare.value).all()


def test_another_shape_has_no_table() -> None:
    assert table_for(changed("TI", plane="strain")) is None
    assert table_for(changed("TI", indenter={"radius_mm": 7.0})), "one table serves every size"


def test_a_few_presses_make_a_table_that_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block = changed("TI", plane="strain")
    monkeypatch.setattr(kept, "KEPT", tmp_path)
    counted: list[tuple[int, int]] = []
    table = touch_table(block, 5, counting=lambda done, total: counted.append((done, total)))
    assert counted[-1] == (10, 10)
    kept.kept_as(table)
    found = table_for(block)
    assert found is not None and found.about == dict(table.about)
    kept.table_for.cache_clear()


@pytest.mark.parametrize(("x_mm", "depth_mm", "across_mm"), [(52.0, 7.5, 7.5), (12.0, 10.0, 4.5)])
def test_a_bump_far_from_the_block_s_middle_is_in_its_place(
    x_mm: float, depth_mm: float, across_mm: float
) -> None:
    """By how much [mm] the table's would have to be moved to fit the finite elements' best."""
    scene = palpate.load_scene("TIT")
    moved = {"x_mm": x_mm, "depth_mm": depth_mm, "diameter_mm": across_mm}
    over = scene.model_copy(update={"inclusion": (scene.inclusion[0].model_copy(update=moved),)})
    bare = scene.model_copy(update={"inclusion": ()})
    at_mm, k = x_mm + np.arange(-6.0, 7.0, 2.0), 2
    solved_n = [[at_depths(each, 1e-3 * x)[k].force_n[0] for x in at_mm] for each in (over, bare)]

    def bump_n(aside_mm: float) -> Array:
        return np.subtract(*(
            palpate.touch(each).force_n(at_mm - aside_mm, 5 * SUNK[k]) for each in (over, bare)
        ))  # fmt: skip

    slope = (bump_n(0.1) - bump_n(-0.1)) / 0.2
    off = slope @ (np.subtract(*solved_n) - bump_n(0.0)) / (slope @ slope)
    assert abs(off) < 0.16
