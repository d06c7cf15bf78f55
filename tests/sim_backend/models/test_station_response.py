"""What the phantom feels: between the states that are solved, and where the finger meets nothing or
only in part."""

import numpy as np
import pytest

from sim_backend.fem.continuation import continuation, unloaded
from sim_backend.fem.newton import Load
from sim_backend.models.plane_response import section_for
from sim_backend.models.response import levels_pa
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import load_scene
from sim_backend.scene.waves import PA_PER_MMHG

DEPTH_M = 2.5e-3


@pytest.mark.parametrize("name", ["HAOT", "SAOT"])
def test_beside_a_lone_vessel_nothing_is_felt(name: str) -> None:
    scene = load_scene(name)
    beside = respond(scene, 1e-3 * scene.inclusion[0].x_mm + 20e-3, 2.5e-3)
    depth, pressure = np.linspace(-1e-3, 2.5e-3, 8), 100.0 * PA_PER_MMHG
    assert (beside.force_n(beside.x_m, depth, np.array(pressure)) == 0.0).all()
    assert (beside.von_mises_pa(beside.x_m, depth, np.array(pressure)) == 0.0).all()


def test_at_the_edge_of_a_lone_vessel_the_first_steps_are_in_the_air() -> None:
    scene = load_scene("HAOT")
    edge = respond(scene, 1e-3 * scene.inclusion[0].x_mm + 5e-3, 2.5e-3)
    force = edge.force_n(edge.x_m, np.linspace(0.0, 2.5e-3, 26), np.array(100.0 * PA_PER_MMHG))
    assert force[0] == 0.0 < force[-1]
    assert (np.diff(force) >= 0).all()


def test_between_solved_states_little_is_missed() -> None:
    """Depths and pressures that were not solved, against the same mesh solved there."""
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
        x_m, np.append(depths, np.full(3, DEPTH_M)), np.append(np.full(4, rest), pressures)
    )
    assert ours[:4] == pytest.approx(truth[:4], abs=1.5e-3 * truth[3])
    pulse = np.ptp(found.force_n(x_m, np.full(2, DEPTH_M), np.array([low, high])))
    assert ours[4:] == pytest.approx(truth[4:], abs=2e-3 * pulse)
