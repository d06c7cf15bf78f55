"""A touch table against the finite elements that it was trained on, and what it imports."""

from pathlib import Path

import numpy as np
import pytest

import palpate
from sim_backend.touch.basis import Basis
from sim_backend.touch.kept import table_for
from sim_backend.touch.kinds import LUMP, VESSEL
from sim_backend.touch.table import TouchTable

R_MM = 5.0


@pytest.fixture(scope="module")
def table() -> TouchTable:
    found = table_for(palpate.load_scene("TI"))
    assert found is not None
    return found


def test_derivatives_of_the_basis_are_those_of_its_values() -> None:
    basis, step = Basis(3, 4), 1e-6
    at = np.random.default_rng(0).uniform(-1, 1, (5, 3))
    for k, by in enumerate(basis.derivatives(at)):
        ahead, behind = (basis.values(at + s * step * np.eye(3)[k]) for s in (1, -1))
        np.testing.assert_allclose(by, (ahead - behind) / (2 * step), atol=1e-6)
    assert len(basis.exponents) == 35  # all products of three up to the fourth degree


def test_the_bare_block_is_that_of_the_finite_elements(table: TouchTable) -> None:
    for x_mm, depth_mm in ((32.0, 2.5), (50.0, 1.2)):
        pressed = palpate.press("TI", x_mm, depth_mm, accuracy_pct=1)
        unit_n = 50e3 * R_MM * 1e-3 * 10e-3
        force_n = unit_n * table.bare_force(
            np.array([(x_mm - 32) / R_MM]), np.array([depth_mm / R_MM])
        )
        assert force_n[0] == pytest.approx(pressed.states[0].force_n, rel=0.01)


@pytest.mark.parametrize(("name", "x_mm"), [("TIT", 32.0), ("TIT", 24.0)])
def test_a_lump_is_that_of_the_finite_elements(name: str, x_mm: float, table: TouchTable) -> None:
    scene = palpate.load_scene(name)
    lump, at, sunk = scene.inclusion[0], np.array([(x_mm - 32) / R_MM]), np.array([0.5])
    assert lump.kind == "tumour" and scene.tissue is not None
    theta = np.array([[
        (lump.x_mm - 32) / R_MM, lump.depth_mm / R_MM, np.log(lump.diameter_mm / R_MM),
        np.log(lump.modulus_kpa / scene.tissue.modulus_kpa),
    ]])  # fmt: skip
    bump = table.ratios["lump"](at, sunk, theta)[0, 0]
    with_lump, bare = (
        palpate.press(one, x_mm, 2.5, accuracy_pct=0.5).states[0].force_n for one in (name, "TI")
    )
    stated = table.ratios["lump"].off_by(theta)[0, 0]
    assert abs(bump - (with_lump / bare - 1)) < 3 * stated + 0.003


def test_a_vessel_pulses_as_the_finite_elements_do(table: TouchTable) -> None:
    scene = palpate.load_scene("TIHA")
    one = scene.arteries[0]
    assert scene.tissue is not None
    pa = 1e3 * scene.tissue.modulus_kpa
    theta = np.array([[
        0.0, one.depth_mm / R_MM, np.log(one.inner_diameter_mm / R_MM),
        np.log(one.wall_mm / one.inner_diameter_mm),
        np.log(one.modulus_kpa / scene.tissue.modulus_kpa), 80 * 133.322 / pa, 40 * 133.322 / pa,
        0.0, 1.0,
    ]])  # fmt: skip
    pulse = table.ratios["vessel"](np.zeros(1), np.array([0.5]), theta)[0, 1]
    pressed, bare = palpate.press("TIHA", 32, 2.5), palpate.press("TI", 32, 2.5)
    assert pressed.pulse_n is not None
    true = pressed.pulse_n / bare.states[0].force_n
    assert abs(pulse - true) < 2 * table.ratios["vessel"].off_by(theta)[0, 1] + 0.02 * true


def test_many_bodies_at_once_are_each_alone(table: TouchTable) -> None:
    rng = np.random.default_rng(1)
    x, sunk = np.array([-2.0, 0.0, 1.5]), np.array([0.2, 0.5])
    for kind in (LUMP, VESSEL):
        low, high = np.array(kind.low), np.array(kind.high)
        theta = low + (high - low) * rng.uniform(0.3, 0.7, (4, len(low)))
        at_once = table.ratios[kind.name].at_depths(sunk)(x, theta)
        for m, body in enumerate(theta):
            for n, place in enumerate(x):
                bodies = np.tile(body, (len(sunk), 1))
                alone = table.ratios[kind.name](np.full(len(sunk), place), sunk, bodies)
                np.testing.assert_allclose(at_once[m, n], alone, rtol=1e-9, atol=1e-12)


def test_a_table_is_read_as_it_was_written(table: TouchTable, tmp_path: Path) -> None:
    table.save(tmp_path / "t.npz")
    again = TouchTable.load(tmp_path / "t.npz")
    assert again.about == dict(table.about)
    x, sunk = np.array([1.0]), np.array([0.3])
    assert again.bare_force(x, sunk) == table.bare_force(x, sunk)
    assert again.ratios.keys() == table.ratios.keys()


def test_another_finger_has_no_table() -> None:
    block = palpate.load_scene("TI")
    other = block.model_copy(update={"indenter": block.indenter.model_copy(
        update={"radius_mm": 7.0})})  # fmt: skip
    assert table_for(other) is None
