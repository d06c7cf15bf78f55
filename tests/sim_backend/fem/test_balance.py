"""What no press may break: work against energy, symmetry, reversal, complementarity."""

import numpy as np
import pytest
from changed_scene import changed
from lumen_area import lumen_area_m2
from small_block import BLOCK

from sim_backend.fem import section as section_rules
from sim_backend.fem.continuation import continuation
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.internal import deformation
from sim_backend.fem.material import energy_density, plane_stress
from sim_backend.fem.model import build_section
from sim_backend.fem.newton import Load, unloaded
from sim_backend.scene.scene_file import Scene, load_scene, mirrored
from sim_backend.scene.waves import PA_PER_MMHG

DEPTH_M = 2.0e-3
P = 100 * PA_PER_MMHG


def energy_j_per_m(section, u):
    f = deformation(section, u)
    g, k = section.shear[:, None], section.bulk[:, None]
    l3 = plane_stress(f, g, k).thickness if section.plane_stress else np.ones(f.shape[:2])
    return float((energy_density(f, l3, g, k) * section.cells.weight).sum())


def marched(section, loads):
    return list(continuation(section, unloaded(section), loads))


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_work_of_the_finger_is_stored(plane):
    """The integral of F over depth is the energy, to the error of the trapezium rule."""
    section = build_section(changed("TIHA", plane=plane), 0.030, depth_m=DEPTH_M, size_m=1e-3)
    errors = []
    for steps in (8, 16):
        depths = DEPTH_M * np.arange(1, steps + 1) / steps
        solved = marched(section, [Load(d, 0.0) for d in depths])
        force = [0.0, *(s.force_n_per_m for s in solved)]
        work = np.trapezoid(force, np.append(0.0, depths))
        errors.append(abs(work / energy_j_per_m(section, solved[-1].displacement) - 1))
    assert errors[1] < 0.35 * errors[0]  # second order
    assert errors[1] < 0.005


def test_work_of_the_pressure_is_stored():
    """In plane strain the lumen's pressure does p dA of work; the finger stands still."""
    section = build_section(changed("TIHA", plane="strain"), 0.030, depth_m=DEPTH_M, size_m=1e-3)
    (sides,) = section.lumens
    down = [Load(DEPTH_M / 2, 0.0), Load(DEPTH_M, 0.0)]
    solved = marched(section, [*down, *(Load(DEPTH_M, P * k / 10) for k in range(1, 11))])[1:]
    area = [lumen_area_m2(sides, s.displacement) for s in solved]
    work = np.trapezoid([s.load.pressure_pa for s in solved], area)
    stored = [energy_j_per_m(section, solved[i].displacement) for i in (-1, 0)]
    assert work == pytest.approx(stored[0] - stored[1], rel=0.003)
    assert work > 0


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_press_lift_press(plane):
    section = build_section(changed("TIHA", plane=plane), 0.033, depth_m=DEPTH_M, size_m=1e-3)
    half, full, lifted = Load(DEPTH_M / 2, P), Load(DEPTH_M, P), Load(-DEPTH_M, P)
    first, second, _, again, third = marched(section, [half, full, lifted, half, Load(DEPTH_M, 0)])
    (direct,) = continuation(section, third, [full])
    assert again.force_n_per_m == pytest.approx(first.force_n_per_m, rel=1e-4)
    assert direct.force_n_per_m == pytest.approx(second.force_n_per_m, rel=1e-4)
    np.testing.assert_allclose(direct.displacement, second.displacement, atol=2e-7)


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_contact_is_complementary(plane):
    section = build_section(changed("TIHA", plane=plane), 0.032, depth_m=DEPTH_M, size_m=0.8e-3)
    *_, solved = marched(section, [Load(DEPTH_M / 2, P), Load(DEPTH_M, P)])
    pair = section.contact_pairs(solved.displacement, DEPTH_M)[0]
    multiplier = solved.multiplier[0]
    on = multiplier > 0
    assert multiplier.min() >= 0
    assert np.abs(pair.gap[on]).max() < 1e-7
    assert pair.gap[~on].min() > -1e-7
    assert 4 < on.sum() < len(on)


def test_a_scene_and_its_mirror():
    lump = {"kind": "tumour", "x_mm": 24.0, "depth_mm": 6.0, "diameter_mm": 5.0,
            "modulus_kpa": 1000.0, "poisson": 0.49}  # fmt: skip
    (artery,) = load_scene("TIHA").model_dump()["inclusion"]
    flat = {"shape": "flat", "width_mm": 6.0, "edge_radius_mm": 1.0}
    beside = [lump, artery | {"x_mm": 36.0, "depth_mm": 9.0}]
    scene = Scene.model_validate(
        load_scene("TI").model_dump() | {"inclusion": beside, "indenter": flat}
    )
    (_, here), (_, there) = (
        solve_finite(s, x, DEPTH_M, [0.0, P], 0.6e-3)
        for s, x in ((scene, 0.030), (mirrored(scene), 0.034))
    )
    forces = [[s.force_n_per_m for s in each] for each in (here, there)]
    np.testing.assert_allclose(forces[0], forces[1], rtol=0.003)  # the meshes are not mirrored


def test_moving_the_vessels_away_leaves_the_block():
    forces = [
        solve_finite(s, 0.032, DEPTH_M, [0.0], 0.8e-3)[1][0].force_n_per_m
        for s in (load_scene("TI"), changed("TIT", inclusion={"modulus_kpa": 50.0}))
    ]
    assert forces[1] == pytest.approx(forces[0], rel=0.002)


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_stiffer_tissue_pushes_back_in_proportion(scale):
    scene = load_scene("TIT")
    (lump,) = scene.inclusion
    other = changed(scene, tissue={"modulus_kpa": 50.0 * scale},
                    inclusion={"modulus_kpa": lump.modulus_kpa * scale})  # fmt: skip
    forces = [
        solve_finite(s, 0.030, DEPTH_M, [0.0], 1e-3)[1][0].force_n_per_m for s in (scene, other)
    ]
    assert forces[1] == pytest.approx(scale * forces[0], rel=1e-4)


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_forces_and_gaps_close_together(plane, monkeypatch):
    """Where the contact stays, Newton's method squares its error."""
    monkeypatch.setattr(section_rules, "CHORDS", 1)
    section = build_section(changed(BLOCK, plane=plane), 12e-3, depth_m=1.5e-3, size_m=0.5e-3)
    loads = [Load(d, P) for d in (-1.5e-3, 0.1e-3, 0.5e-3, 1e-3, 1.5e-3)]
    _, first, second, third, deep = continuation(section, unloaded(section), loads)
    assert max(s.iterations for s in (first, second, third, deep)) <= 6
    (more,) = continuation(section, deep, [Load(1.5e-3, 1.3 * P)])
    assert more.iterations <= 4
