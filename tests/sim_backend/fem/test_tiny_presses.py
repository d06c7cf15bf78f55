"""Nearly incompressible bodies that hardly move: the bulk modulus does not magnify rounding."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sim_backend.arrays import Array
from sim_backend.fem.axisymmetric import build_axisymmetric, solve_axisymmetric
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.internal import forces_and_tangents
from sim_backend.fem.material import moduli
from sim_backend.fem.model import Grading, build_section, usual_grading
from sim_backend.fem.newton import CannotSolve
from sim_backend.fem.section import Section
from sim_backend.fem.small_strain import solve_small
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene

POISSON = 0.49999
SIZE_M = 1e-3
STRAIN = 1e-12
"""At which the forces' own curvature is 1e-12 of the bulk modulus, 5e-8 of the shear modulus, and
rounding in det F - 1 would be 1e-16 over 1e-12 of the bulk modulus, five shear moduli."""
ROUNDINGS = 20
"""Of the shear stress, that may come together in a force: both sides sum some twenty products."""


def block(plane: str, poisson: float = POISSON, **finger: Any) -> Scene:
    tissue = {"width_mm": 64.0, "height_mm": 16.0, "modulus_kpa": 20.0, "poisson": poisson}
    if plane == "solid":
        tissue |= {"width_mm": 24.0, "length_mm": 24.0}
        finger = {"shape": "sphere", "radius_mm": 4.0}
    else:
        finger = {"shape": "cylinder", "radius_mm": 1.2, "length_mm": 10.0} | finger
    return Scene.model_validate(
        {"name": "block", "plane": plane, "tissue": tissue, "indenter": finger}
    )


def stirred(nodes: Array) -> Array:
    """Displacements (n, 2) at a strain of about 1."""
    turn = np.array([[0.3, 0.9], [-0.7, 0.2]])
    return np.asarray(5e-3 * np.sin(nodes @ turn / 5e-3))


def assert_linear(section: Section) -> None:
    """Forces are the tangent at rest times displacements, but for the rounding of shear stress."""
    cells, u = section.cells, stirred(section.mesh.nodes)
    found = forces_and_tangents(section, STRAIN * u)[0] / STRAIN
    _, tangent = forces_and_tangents(section, np.zeros_like(u))
    slope = np.einsum("mab,mb->ma", tangent, u[cells.nodes].reshape(len(tangent), -1))
    area = np.einsum("mq,mqik->mk", cells.weight, np.abs(cells.gradient)).max()
    rounding = ROUNDINGS * float(np.finfo(float).eps) * section.shear.max() * area
    np.testing.assert_allclose(found, slope, rtol=0, atol=rounding / STRAIN)


@pytest.mark.usefixtures("with_and_without_kernel")
@pytest.mark.parametrize(
    ("plane", "element"), [("stress", "T6"), ("strain", "T6"), ("strain", "Q4M"), ("strain", "Q8R")]
)
def test_forces_are_linear_down_to_the_smallest_strain(plane: str, element: str) -> None:
    assert_linear(build_section(block(plane), 32e-3, depth_m=1e-3, size_m=SIZE_M, element=element))


@pytest.mark.parametrize("element", ["T6", "Q4M"])
def test_forces_of_a_body_of_revolution_are(element: str) -> None:
    scene = block("solid", 0.49 if element == "T6" else POISSON)
    grading = Grading(SIZE_M, lambda radius: 0.3 * radius, 0.35, 4e-3)
    section = build_axisymmetric(scene, 12e-3, 1e-3, grading)
    _, bulk = moduli(20e3, POISSON)
    assert_linear(replace(section, bulk=np.full_like(section.bulk, bulk)))


@pytest.mark.usefixtures("with_and_without_kernel")
@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("depth_m", [1e-6, 1e-7])
def test_a_free_finger_a_hair_deep(plane: str, depth_m: float) -> None:
    """As in small strain, which has no tolerance of forces: 1 um deep, the strain below the finger
    is the root of 2 depth over radius, 4 %, and its square what is missed."""
    scene, x_m = block(plane), 32e-3
    _, (found,) = solve_finite(scene, x_m, depth_m, [0.0], SIZE_M, grading=usual_grading(SIZE_M))
    _, (wanted,) = solve_small(scene, x_m, depth_m, [0.0], SIZE_M, grading=usual_grading(SIZE_M))
    assert found.force_n_per_m == pytest.approx(wanted.force_n_per_m, rel=2e-3)


@pytest.mark.parametrize("x_mm", [20.3, 43.0])
def test_a_bonded_finger(x_mm: float) -> None:
    """It goes down in steps that begin at 1e-6 mm."""
    nearly, more = (
        press(block("stress", poisson, bonded=True), x_mm, 0.25).states[0].force_n
        for poisson in (0.4998, 0.4999)
    )
    assert more == pytest.approx(nearly, rel=1e-3)


def test_a_ball_a_hair_deep() -> None:
    """Hertz: Johnson 1985, eq. 4.23."""
    depth_m = 1e-6
    contact_m = 0.1 * np.sqrt(4e-3 * depth_m)
    grading = Grading(contact_m, lambda radius: 0.3 * radius, 0.35, 4e-3)
    _, (found,) = solve_axisymmetric(block("solid"), 32e-3, depth_m, grading)
    hertz = 4 / 3 * 20e3 / (1 - POISSON**2) * np.sqrt(4e-3) * depth_m**1.5
    assert found.force_n_per_m == pytest.approx(hertz, rel=0.02)


def test_a_finger_that_comes_down_between_nodes_is_said_to() -> None:
    with pytest.raises(CannotSolve, match="touches no node of the mesh 1e-05 mm deep"):
        solve_small(block("stress"), 43.3e-3, 1e-8, [0.0], 0.6e-3)
