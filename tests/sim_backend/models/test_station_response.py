"""What the phantom feels: between the states that are solved, and where the finger meets nothing or
only in part."""

import numpy as np
import pytest
from changed_scene import changed
from flat_lumens import drawn
from soft_walls import soft_walled

from sim_backend.fem.continuation import continuation
from sim_backend.fem.newton import CannotSolve, Load, unloaded
from sim_backend.models.bodies import section_for
from sim_backend.models.press import press, scene_pressures_mmhg
from sim_backend.models.response import levels_pa
from sim_backend.models.station_response import respond
from sim_backend.models.stations import ramp
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.taxels import TaxelArray
from sim_backend.scene.waves import PA_PER_MMHG

DEPTH_M = 2.5e-3
FLAT = {"shape": "flat", "width_mm": 8.0, "edge_radius_mm": 1.0}
STICKS = {"shape": "cylinder", "radius_mm": 5.0, "bonded": True}


@pytest.mark.parametrize("scene", [
    *map(load_scene, ("TI", "TIT", "TISA", "HAOT")), changed("TIHA", plane="strain"),
    changed("TIHA", indenter=FLAT), changed("TIHA", indenter=STICKS),
], ids=["TI", "TIT", "TISA", "lone", "strain", "flat", "bonded"])  # fmt: skip
def test_a_station_is_as_near_to_presses_as_it_states(scene: Scene) -> None:
    x_mm, depth_mm = (32.0, 1.0) if scene.tissue is None else (24.0, 2.5)
    mmhg = scene_pressures_mmhg(scene)
    truth = press(scene, x_mm, depth_mm, mmhg, model="finite", accuracy_pct=0.5)
    depth_m, ends_pa = 1e-3 * depth_mm, PA_PER_MMHG * np.array(mmhg)
    found = respond(scene, 1e-3 * x_mm, depth_m)
    true_n = np.array([state.force_n for state in truth.states])
    allowed_n = found.error_n(depth_m, ends_pa) + 0.01 * truth.force_error_estimate_pct * true_n
    assert (np.abs(found.force_n(depth_m, ends_pa) - true_n) <= allowed_n).all()
    assert (allowed_n <= (0.03 if scene.tissue else 0.08) * true_n).all()
    if scene.arteries:
        off_n = abs(np.ptp(found.force_n(depth_m, ends_pa)) - truth.pulse_n)
        stated_n = float(found.pulse_error_n(depth_m, *ends_pa)) + truth.pulse_error_n
        assert off_n <= stated_n <= 0.1 * truth.pulse_n


def test_a_vessel_pressed_flat_states_more_of_its_pulse() -> None:
    scene, x_m, depth_m = drawn(35)
    ends_pa = 80 * PA_PER_MMHG, 120 * PA_PER_MMHG
    model = respond(scene, x_m, depth_m)
    low, high = (model.force_n(depth_m, p) for p in ends_pa)
    states = press(scene, 1e3 * x_m, 1e3 * depth_m, (80.0, 120.0), accuracy_pct=2.0).states
    off_n = abs(high - low - (states[1].force_n - states[0].force_n))
    assert off_n < model.pulse_error_n(depth_m, *ends_pa)


@pytest.mark.parametrize("name", ["HAOT", "SAOT"])
def test_beside_a_lone_vessel_nothing_is_felt(name: str) -> None:
    scene = load_scene(name)
    beside = respond(scene, 1e-3 * scene.inclusion[0].x_mm + 20e-3, 2.5e-3)
    depth, pressure = np.linspace(-1e-3, 2.5e-3, 8), 100.0 * PA_PER_MMHG
    assert (beside.force_n(depth, np.array(pressure)) == 0.0).all()
    assert (beside.von_mises_pa(depth, np.array(pressure)) == 0.0).all()


def test_at_the_edge_of_a_lone_vessel_the_first_steps_are_in_the_air() -> None:
    scene = load_scene("HAOT")
    edge = respond(scene, 1e-3 * scene.inclusion[0].x_mm + 5e-3, 2.5e-3)
    force = edge.force_n(np.linspace(0.0, 2.5e-3, 26), np.array(100.0 * PA_PER_MMHG))
    assert force[0] == 0.0 < force[-1]
    assert (np.diff(force) >= 0).all()


def test_between_solved_states_taxels_are_the_elements_own() -> None:
    """Within 2 % of the largest; the force is that without an array."""
    scene, x_m, array = load_scene("TIHA"), 28e-3, TaxelArray(1, 8)
    found, plain = respond(scene, x_m, DEPTH_M, array), respond(scene, x_m, DEPTH_M)
    rest, low, high = levels_pa(scene)
    depths = DEPTH_M * np.array([0.3, 0.47, 0.92, 1.0])
    exact = [solved.taxels_n(array)[:, 0] for solved in
             ramp(scene, x_m, list(depths), [rest, low, high])]  # fmt: skip
    taxels = np.array([
        [found.force_n(depth, p) * found.shares(np.array([depth]), np.array([p]))[0, 0]
         for p in (rest, low, high)] for depth in depths
    ])  # fmt: skip
    off = np.abs(taxels - exact)[:, 0].max(axis=1)
    assert (off[:3] < 0.02 * np.max(exact)).all()
    assert off[3] < 1e-6 * np.max(exact)
    pulse, pulse_there = (each[3, 2] - each[3, 1] for each in (taxels, np.array(exact)))
    assert np.abs(pulse - pulse_there).max() < 0.02 * np.abs(pulse_there).max()
    for depth in depths:
        force = plain.force_n(depth, [rest, low, high])
        np.testing.assert_allclose(found.force_n(depth, [rest, low, high]), force, rtol=1e-6)


def test_between_solved_states_little_is_missed() -> None:
    scene, x_m = load_scene("TIHA"), 28e-3
    found = respond(scene, x_m, DEPTH_M)
    section = section_for(scene, x_m, DEPTH_M)
    rest, low, high = levels_pa(scene)
    depths = DEPTH_M * np.array([0.1, 0.35, 0.75, 1.0])
    pressures = low + (high - low) * np.array([0.05, 0.6, 0.9])
    (filled,) = continuation(section, unloaded(section), [Load(-DEPTH_M, rest)])
    down = list(continuation(section, filled, [Load(float(d), rest) for d in depths]))
    beat = list(continuation(section, down[-1], [Load(DEPTH_M, float(p)) for p in pressures]))
    length_m = 1e-3 * scene.indenter.length_mm
    truth = length_m * np.array([s.force_n_per_m for s in (*down, *beat)])
    ours = found.force_n(
        np.append(depths, np.full(3, DEPTH_M)), np.append(np.full(4, rest), pressures)
    )
    assert ours[:4] == pytest.approx(truth[:4], abs=1.5e-3 * truth[3])
    pulse = np.ptp(found.force_n(np.full(2, DEPTH_M), np.array([low, high])))
    assert ours[4:] == pytest.approx(truth[4:], abs=2e-3 * pulse)


@pytest.mark.parametrize("depth_mm", [0.7, 1.4])
def test_over_a_wall_that_nearly_bursts_the_pulse_is_known_as_well_as_stated(
    depth_mm: float,
) -> None:
    scene = soft_walled(176.0, 14.0, modulus_kpa=167.0, wall_mm=0.45, depth_mm=10.44)
    found = respond(scene, 29.6e-3, 1.4e-3)
    truth = press(scene, 29.6, depth_mm, [80.0, 176.0])
    _, low, high = levels_pa(scene)
    depth_m = 1e-3 * depth_mm
    pulse_n = np.ptp(found.force_n(depth_m, np.array([low, high])))
    assert pulse_n == pytest.approx(truth.pulse_n, rel=0.1)
    stated_n = float(found.pulse_error_n(depth_m, low, high))
    assert pulse_n == pytest.approx(truth.pulse_n, abs=stated_n)
    off_n = found.force_n(depth_m, high) - truth.states[-1].force_n
    assert abs(off_n) <= found.error_n(depth_m, high)


def test_a_wall_that_bursts_where_the_finger_is_less_deep_is_refused() -> None:
    scene = soft_walled(185.0, 46.0, modulus_kpa=63.0, wall_mm=0.4, depth_mm=6.4)
    with pytest.raises(CannotSolve, match="inflates without bound"):
        respond(scene, 32e-3, 1.5e-3)
