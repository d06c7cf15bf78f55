"""The quick answer of a place, where the finger meets nothing or only in part."""

import numpy as np
import pytest

from sim_backend import load_scene
from sim_backend.models.station_response import respond
from sim_backend.scene.waves import PA_PER_MMHG


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
