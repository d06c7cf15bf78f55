"""A solid's cut at z = 0: what it shows of a deformation that is known everywhere."""

from dataclasses import replace

import numpy as np
import pytest
from small_solid import small_solid, vessel

from sim_backend.fem.material_3d import von_mises
from sim_backend.fem.newton import unloaded
from sim_backend.fem.solid.build import build_body
from sim_backend.fem.solid.cut import Cut


@pytest.mark.parametrize("z_mm", [0.0, 1.5], ids=["half", "whole"])
def test_a_cut_shows_the_section_and_its_stress(z_mm: float) -> None:
    scene = small_solid(14.0, 12.0, vessel(7.0), z_mm=z_mm)
    body = build_body(scene, 7e-3, depth_m=0.5e-3, size_m=1.4e-3)
    cut = Cut(body)
    assert (body.wedges.nodes[cut.numbers, 2] == 0).all()
    a, b, c = np.moveaxis(cut.nodes_m[cut.triangles], 1, 0)
    first, second = b - a, c - a
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum() / 2
    assert 1e6 * area == pytest.approx(14.0 * 8.0 - np.pi, rel=2e-3)
    stretch = np.array([[0.05, 0.1, 0.0], [0.0, -0.15, 0.02], [0.03, 0.0, 0.04]])
    displacement = body.wedges.nodes @ stretch.T
    displacement[:, 0] += 80.0 * body.wedges.nodes[:, 2] ** 2  # no shear at z = 0, much beside it
    moved = replace(unloaded(body), displacement=displacement)
    assert cut.displacement_m(moved) == pytest.approx(cut.nodes_m @ stretch[:2, :2].T)
    stress = cut.von_mises_pa(moved)
    corner = np.argmin(np.hypot(*cut.nodes_m.T))
    assert stress[corner] == pytest.approx(
        float(von_mises(np.eye(3) + stretch, np.array(body.shear.min())))
    )
    stiffest = float(von_mises(np.eye(3) + stretch, np.array(body.shear.max())))
    assert stress.max() == pytest.approx(stiffest)
