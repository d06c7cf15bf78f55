"""What is read under the finger."""

from dataclasses import replace

import numpy as np
import pytest
from small_block import BLOCK

from sim_backend.fem.material import plane_stress, von_mises
from sim_backend.fem.model import build_section
from sim_backend.fem.stress import under_finger_pa


@pytest.mark.parametrize("x_m", [1e-3, 7.3e-3])
def test_even_strain_is_read_as_it_is(x_m: float) -> None:
    section = build_section(BLOCK, x_m, depth_m=1e-3, size_m=0.5e-3)
    gradient = np.array([[0.06, 0.02], [-0.01, -0.09]])
    f = (gradient + np.eye(2)).reshape(4)
    shear, bulk = section.shear[0], section.bulk[0]
    surface = section.mesh.surface
    on_surface = np.isin(section.cells.nodes, surface).any(axis=1)
    assert (section.shear[on_surface] == shear).all()  # all of it tissue
    thickness = plane_stress(f, shear, bulk).thickness if section.plane_stress else np.array(1.0)
    expected = float(von_mises(f, thickness, shear))
    assert under_finger_pa(section, section.mesh.nodes @ gradient.T) == pytest.approx(expected)


def test_stress_is_read_under_the_finger_and_nowhere_else() -> None:
    """A stretch that grows along the surface from the finger's middle: quadratic elements hold it
    exactly."""
    section = build_section(BLOCK, 7e-3, depth_m=1e-3, size_m=0.5e-3)
    nodes = section.mesh.nodes
    bent = np.column_stack([10.0 * (nodes[:, 0] - 7e-3) ** 2, np.zeros(len(nodes))])
    read = [
        under_finger_pa(replace(section, finger=replace(section.finger, x=x)), bent)
        for x in (7e-3, 8e-3, 9e-3)
    ]
    assert read[0] < 0.1 * read[1] < 0.07 * read[2]
