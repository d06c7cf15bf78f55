"""A touch table against the finite elements that it was trained on, and what it imports."""

from pathlib import Path

import numpy as np
import pytest

import palpate
from sim_backend.models.train_touch import Units, random_press, sample, touch_table
from sim_backend.touch import kept
from sim_backend.touch.basis import Basis
from sim_backend.touch.kept import table_for
from sim_backend.touch.kinds import LUMP, VESSEL
from sim_backend.touch.table import TouchTable, block_of

R_MM = 5.0


@pytest.fixture(scope="module")
def table() -> TouchTable:
    found = table_for(palpate.load_scene("TI"))
    assert found is not None
    return found


def other_block(name: str, **changed: float) -> palpate.Scene:
    scene = palpate.load_scene(name)
    return scene.model_copy(update={"tissue": scene.tissue.model_copy(update=changed)})


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
    scene = other_block("TI", **size_mm)
    assert scene.tissue is not None
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
    """Of what moves no mesh, a modulus and a pressure: presses beside it are solved again."""
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
    block = palpate.load_scene("TI")
    assert table_for(block.model_copy(update={"plane": "strain"})) is None
    other = block.model_copy(update={"indenter": block.indenter.model_copy(
        update={"radius_mm": 7.0})})  # fmt: skip
    assert table_for(other) is not None, "one table serves every size"


def test_a_few_presses_make_a_table_that_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block = palpate.load_scene("TI").model_copy(update={"plane": "strain"})
    monkeypatch.setattr(kept, "KEPT", tmp_path)
    counted: list[tuple[int, int]] = []
    table = touch_table(block, 5, counting=lambda done, total: counted.append((done, total)))
    assert counted[-1] == (10, 10)
    kept.kept_as(table)
    found = table_for(block)
    assert found is not None and found.about == dict(table.about)
    kept.table_for.cache_clear()
