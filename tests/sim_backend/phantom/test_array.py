"""A simulated array reads what the elements say is on each taxel, as far as its faults let it."""

from typing import Any

import numpy as np
import pytest
from small_block import BLOCK
from small_solid import small_solid, vessel

from drivers import Block, ConfigError, Pose, SimulatedClock
from sim_backend.arrays import Array
from sim_backend.models.station_response import respond
from sim_backend.phantom.array import Taxels, VirtualArray, under_corner
from sim_backend.phantom.devices import VirtualSensor, virtual_sensor, virtual_stage
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import Scene, SceneError, load_scene

IDEAL: dict[str, Any] = {"rows": 4, "columns": 7, "noise_pa": 0.0, "quantum_pa": 0.0}
SOLID = small_solid(12.0, 12.0, vessel(6.0))


def layout(scene: Scene) -> dict[str, int]:
    """Taxels that a solid's elements can tell apart."""
    return {"rows": 2, "columns": 3} if scene.plane == "solid" else {}


def pressed(
    scene: Scene, x_mm: float, depth_mm: float = 1.0, *, seed: int = 0, respond: Any = respond,
    **keys: Any,
) -> tuple[Block, Phantom, VirtualSensor]:  # fmt: skip
    """All readings of a press and its hold."""
    clock = SimulatedClock()
    phantom = Phantom(scene, clock, respond, home=(1e-3 * x_mm, 0.0, 1e-3), depth_m=1e-3 * depth_mm)
    stage = virtual_stage(clock, phantom=phantom)
    array = VirtualArray.model_validate({**IDEAL, **keys})
    sensor = virtual_sensor(clock, phantom=phantom, rate_hz=100.0, seed=seed, array=array)
    sensor.start()
    stage.move(Pose(1e-3 * x_mm, 0.0, -1e-3 * depth_mm), 5e-3)
    clock.sleep_until(1.5)
    return sensor.read(), phantom, sensor


def held(scene: Scene, x_mm: float, **keys: Any) -> Array:
    """The last reading (rows, columns) [Pa]."""
    block, phantom, _ = pressed(scene, x_mm, **keys)
    return block.values[-1].reshape(phantom.array.rows, phantom.array.columns)


@pytest.mark.parametrize("scene, x_mm, depth_mm", [
    (load_scene("TIHA"), 32.0, 2.5), (load_scene("TIT"), 27.0, 2.0), (SOLID, 5.0, 1.0),
], ids=["artery", "lump", "solid"])  # fmt: skip
def test_all_taxels_together_are_the_force(scene: Scene, x_mm: float, depth_mm: float) -> None:
    block, phantom, sensor = pressed(scene, x_mm, depth_mm, **layout(scene))
    force_n = phantom.force_n(block.time_s)
    taxel_m2 = 1e-6 * scene.face_mm2 / len(sensor.channels)
    assert force_n[-1] > 0.05
    np.testing.assert_allclose(block.values.sum(axis=1) * taxel_m2, force_n, rtol=5e-3, atol=1e-6)
    assert [c.name for c in sensor.channels[:2]] == ["r0c0", "r0c1"]
    assert {(c.unit, c.role, c.simulated) for c in sensor.channels} == {("Pa", "taxel", True)}


@pytest.mark.parametrize(
    ("scene", "x_mm"), [(load_scene("TIHA"), 32.0), (SOLID, 6.0)], ids=["section", "solid"]
)
def test_over_what_is_symmetric_both_sides_read_alike(scene: Scene, x_mm: float) -> None:
    found = held(scene, x_mm, **layout(scene))
    np.testing.assert_allclose(found, found[:, ::-1], atol=0.01 * found.max())
    np.testing.assert_allclose(found, found[::-1], atol=0.01 * found.max())
    assert found.max() > 1.2 * found.mean()


def side(found: Array) -> float:
    """Where the middle of the force is, in columns from the array's middle."""
    columns = np.arange(found.shape[1]) - (found.shape[1] - 1) / 2
    return float((found.sum(axis=0) * columns).sum() / found.sum())


@pytest.mark.parametrize(("x_mm", "sign"), [(28.0, 1), (36.0, -1)])
def test_a_lump_4_mm_aside_is_felt_on_its_side(x_mm: float, sign: int) -> None:
    """With gains that differ by 1 %, as many as 19 of 20 arrays say which side it is on."""
    sides = [
        side(held(load_scene("TIT"), x_mm, depth_mm=2.5, seed=seed, gain_spread_pct=1.0, rows=1,
                  columns=8))
        for seed in range(20)
    ]  # fmt: skip
    assert sum(sign * one > 0 for one in sides) >= 19


def test_a_place_and_its_mirror_image_read_mirrored() -> None:
    beside = {"kind": "tumour", "x_mm": 4.0, "z_mm": 1.0, "depth_mm": 4.0, "diameter_mm": 3.0,
              "modulus_kpa": 1000.0, "poisson": 0.45}  # fmt: skip
    found = {}
    for x_mm, z_mm in ((4.0, 1.0), (8.0, 1.0), (4.0, -1.0)):
        scene = small_solid(12.0, 12.0, {**beside, "x_mm": x_mm, "z_mm": z_mm})
        found[x_mm, z_mm] = held(scene, 6.0, **layout(scene))
    first = found[4.0, 1.0]
    assert side(first) < -0.02
    assert side(first.T) > 0.01  # towards the lump along z, too
    np.testing.assert_allclose(found[8.0, 1.0], first[:, ::-1], rtol=1e-9)
    np.testing.assert_allclose(found[4.0, -1.0], first[::-1], rtol=1e-9)


def test_a_load_cell_and_an_array_on_one_finger_feel_one_press() -> None:
    scene, clock = BLOCK, SimulatedClock()
    phantom = Phantom(scene, clock, respond, home=(10e-3, 0.0, 1e-3), depth_m=1e-3)
    stage = virtual_stage(clock, phantom=phantom)
    cell = virtual_sensor(clock, phantom=phantom, noise_mn=0.0, quantum_mn=0.0)
    array = virtual_sensor(clock, phantom=phantom, array=VirtualArray.model_validate(IDEAL))
    assert (cell.name, array.name) == ("force", "taxels")
    with pytest.raises(SceneError, match="a finger carries one array"):
        virtual_sensor(clock, phantom=phantom, array=VirtualArray(rows=2, columns=2))
    cell.start()
    array.start()
    stage.move(Pose(10e-3, 0.0, -1e-3), 5e-3)
    clock.sleep_until(1.0)
    mean_pa = array.read().values.mean(axis=1)
    force_n = cell.read().values[:, 0]
    np.testing.assert_allclose(mean_pa * 1e-6 * scene.face_mm2, force_n, rtol=1e-9, atol=1e-9)


def test_an_array_may_come_onto_a_finger_whose_places_are_solved(winkler: Any) -> None:
    clock = SimulatedClock()
    phantom = Phantom(load_scene("TI"), clock, winkler, home=(0.032, 0.0, -1e-3))
    phantom.prepare([(0.032, 0.0)])
    sensor = virtual_sensor(clock, phantom=phantom, array=VirtualArray.model_validate(IDEAL))
    sensor.start()
    clock.sleep_until(0.1)
    assert (sensor.read().values[-1] > 0).all()


def matrix(winkler: Any, **keys: Any) -> Array:
    """From forces [N] to readings [N]."""
    phantom = Phantom(load_scene("TI"), SimulatedClock(), winkler)
    array = VirtualArray.model_validate({**IDEAL, "pitch_mm": 1.0, **keys})
    return 1e-6 * Taxels(phantom, array, "skin", 3)._pa_per_n


def test_what_is_dead_reads_nothing_not_even_noise(winkler: Any) -> None:
    block, *_ = pressed(
        load_scene("TI"), 32.0, respond=winkler, dead=[[1, 2], [3, 6]], noise_pa=50.0
    )
    dead = (block.values == 0).all(axis=0)
    assert np.flatnonzero(dead).tolist() == [9, 27]
    assert (block.values[:, ~dead].std(axis=0) > 20).all()


def test_gains_differ_as_stated_and_by_the_seed(winkler: Any) -> None:
    gains = np.diag(matrix(winkler, rows=40, columns=40, gain_spread_pct=2.0))
    assert gains.std() == pytest.approx(0.02, rel=0.1)
    assert gains.mean() == pytest.approx(1.0, abs=0.002)
    assert (gains == np.diag(matrix(winkler, rows=40, columns=40, gain_spread_pct=2.0))).all()


def test_crosstalk_shows_on_the_neighbours(winkler: Any) -> None:
    shown = matrix(winkler, crosstalk_pct=5.0)[:, 9].reshape(4, 7)  # of row 1, column 2
    wanted = np.zeros((4, 7))
    wanted[1, 2], wanted[[0, 2, 1, 1], [2, 2, 1, 3]] = 1.0, 0.05
    np.testing.assert_allclose(shown, wanted)


def test_a_skin_spreads_a_force_and_keeps_what_stays_on_the_array(winkler: Any) -> None:
    spread = matrix(winkler, rows=15, columns=15, skin_spread_mm=1.0)
    middle = spread[:, 112].reshape(15, 15)
    assert middle.sum() == pytest.approx(1.0, abs=0.02)  # a little passes beside it
    np.testing.assert_allclose(middle, middle[::-1, ::-1], atol=1e-12)
    assert 0.2 < middle.max() < 0.5
    assert spread[:, 0].sum() < 0.7  # a corner's goes three ways out


def test_under_a_rectangle_s_corner_is_what_point_loads_add_up_to() -> None:
    """3 F z^3 / (2 pi r^5) under each (Johnson 1985, eq. 3.20c)."""
    n, (a, b, deep) = 400, (2e-3, 1e-3, 0.7e-3)
    x, y = np.meshgrid((np.arange(n) + 0.5) * a / n, (np.arange(n) + 0.5) * b / n)
    points = 3 * deep**3 / (2 * np.pi * (x**2 + y**2 + deep**2) ** 2.5) * a * b / n**2
    assert float(under_corner(np.array(a), np.array(b), deep)) == pytest.approx(
        float(points.sum()), rel=1e-4
    )


def test_steps_full_scale_and_noise_are_as_stated(winkler: Any) -> None:
    block, _, sensor = pressed(
        load_scene("TI"), 32.0, 2.5, respond=winkler, quantum_pa=250.0, full_scale_kpa=5.0
    )
    np.testing.assert_allclose(block.values / 250, np.round(block.values / 250))
    assert {channel.full_scale for channel in sensor.channels} == {5000.0}
    assert (block.values[block.saturated] == 5000.0).all()
    assert block.values.max() == 5000.0
    assert 0 < block.saturated[-1].sum() < 28
    noisy, *_ = pressed(load_scene("TI"), 32.0, respond=winkler, noise_pa=30.0, seed=5)
    quiet, *_ = pressed(load_scene("TI"), 32.0, respond=winkler, seed=5)
    noise = noisy.values - quiet.values
    assert noise.std() == pytest.approx(30.0, rel=0.05)
    assert abs(np.corrcoef(noise[:, 0], noise[:, 1])[0, 1]) < 0.3
    again, *_ = pressed(load_scene("TI"), 32.0, respond=winkler, noise_pa=30.0, seed=5)
    assert again.values.tobytes() == noisy.values.tobytes()


@pytest.mark.parametrize("keys, words", [
    ({"dead": [[4, 0]]}, r"dead = \[4, 0\]: rows are 0 to 3, columns 0 to 6"),
    ({"rows": 100, "columns": 100}, "taxels = 100 x 100"),
    ({"rows": 0}, "greater than or equal to 1"),
])  # fmt: skip
def test_an_array_that_cannot_be_is_refused(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        VirtualArray.model_validate({**IDEAL, **keys})


def test_taxels_too_fine_for_a_solid_are_refused() -> None:
    with pytest.raises(SceneError, match="finer than a solid's elements can tell apart"):
        held(SOLID, 6.0)


def test_a_load_cell_s_keys_are_no_array_s(winkler: Any) -> None:
    clock = SimulatedClock()
    phantom = Phantom(load_scene("TI"), clock, winkler)
    with pytest.raises(ConfigError, match="noise_mn = 2: is a load cell's key; an array's are arr"):
        virtual_sensor(clock, phantom=phantom, noise_mn=2.0, array=VirtualArray(rows=1, columns=2))
