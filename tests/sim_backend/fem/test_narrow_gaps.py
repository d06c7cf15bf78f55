"""Meshes where inclusions nearly touch each other, the surface or the bottom."""

from math import pi

import numpy as np
import pytest

from sim_backend.fem.model import Grading, build_section
from sim_backend.fem.section import Section
from sim_backend.models.section_meshes import FIRST_SHARE, mesh_grading
from sim_backend.scene.inclusion import Artery, Inclusion
from sim_backend.scene.scene_file import Scene, SceneError

HEIGHT_MM = 18.0


def vessel(radius: float, x: float, depth: float) -> dict[str, object]:
    return {"kind": "artery", "x_mm": x, "depth_mm": depth, "inner_diameter_mm": 1.6 * radius,
            "wall_mm": 0.2 * radius, "modulus_kpa": 300.0, "poisson": 0.45}  # fmt: skip


def lump(radius: float, x: float, depth: float) -> dict[str, object]:
    return {"kind": "tumour", "x_mm": x, "depth_mm": depth, "diameter_mm": 2 * radius,
            "modulus_kpa": 500.0, "poisson": 0.45}  # fmt: skip


def scene_of(*inclusions: dict[str, object], finger_mm: float = 5.0) -> Scene:
    return Scene.model_validate(
        {
            "name": "near",
            "plane": "strain",
            "tissue": {"width_mm": 64.0, "height_mm": HEIGHT_MM, "modulus_kpa": 50.0,
                       "poisson": 0.45},
            "inclusion": list(inclusions),
            "indenter": {"shape": "cylinder", "radius_mm": finger_mm},
        }
    )  # fmt: skip


def meshed(scene: Scene, share: float) -> Section:
    size_m = share * 0.5e-3 * scene.indenter.width_mm_projected
    grading = mesh_grading(scene, size_m, share)
    return build_section(scene, 30e-3, depth_m=2e-3, size_m=size_m, grading=grading)


def area_mm2(one: Inclusion) -> float:
    outer = pi * one.outer_radius_mm**2
    return outer - pi * (one.inner_diameter_mm / 2) ** 2 if isinstance(one, Artery) else outer


GAPS = {
    "side by side, 5 um": (scene_of(lump(2.5, 32, 9), vessel(1.5, 36.005, 9), finger_mm=9), 0.5),
    "three, 8 um": (
        scene_of(vessel(2, 32, 9), vessel(1.3, 35.308, 9), lump(2.2, 27.792, 9.5)), 0.25,
    ),
    "over the bottom, 11 um": (scene_of(vessel(2, 32, HEIGHT_MM - 2.011)), 0.12),
    "over the bottom, 0.12 mm": (scene_of(vessel(2, 32, HEIGHT_MM - 2.12)), 0.5),
    "under the surface, 50 um": (scene_of(lump(3.2, 32, 3.25)), 0.5),
    "under the surface, 0.4 mm": (scene_of(lump(1.5, 32, 1.9), finger_mm=9), 0.12),
}  # fmt: skip


@pytest.mark.parametrize(("scene", "share"), GAPS.values(), ids=GAPS.keys())
def test_inclusions_keep_their_area(scene: Scene, share: float) -> None:
    section = meshed(scene, share)
    area = 1e6 * section.cells.weight.sum(axis=1)
    hollow = sum(pi * (one.inner_diameter_mm / 2) ** 2 for one in scene.arteries)
    assert area.sum() == pytest.approx(64 * HEIGHT_MM - hollow, rel=1e-5)
    for n, one in enumerate(scene.inclusion):
        assert area[section.mesh.region == 1 + 2 * n].sum() == pytest.approx(
            area_mm2(one), rel=2e-4
        )


def test_a_gap_that_is_too_narrow_is_named() -> None:
    scene = scene_of(lump(2, 32, 9), vessel(1, 35.0000005, 9))
    with pytest.raises(SceneError, match=r"inclusion\[0\] and inclusion\[1\] are .* at least 1 um"):
        meshed(scene, FIRST_SHARE)


def test_whatever_bounds_an_element_shrinks_with_the_mesh() -> None:
    scene = scene_of(vessel(1, 32, 1.2), finger_mm=9)
    coarse, fine = meshed(scene, 0.4), meshed(scene, 0.1)
    cells = [np.bincount(one.mesh.region, minlength=2) for one in (coarse, fine)]
    assert cells[1][1] > 8 * cells[0][1]  # the wall, where 16 times as many would be right
    above = [
        int((one.mesh.nodes[one.mesh.cells].mean(axis=1)[:, 1] > 1e-3 * (HEIGHT_MM - 0.2)).sum())
        for one in (coarse, fine)
    ]
    assert above[1] > 4 * above[0]


def test_two_points_that_are_held_in_the_same_corner_make_a_mesh() -> None:
    scene = Scene.model_validate(
        {
            "name": "corner",
            "plane": "stress",
            "tissue": {"width_mm": 64.0, "height_mm": 9.757622685338198, "modulus_kpa": 18.6,
                       "poisson": 0.3},
            "inclusion": [{"kind": "artery", "x_mm": 32.0, "depth_mm": 4.550529562432968,
                           "inner_diameter_mm": 6.831416500966149, "wall_mm": 0.4632275958535008,
                           "modulus_kpa": 731.0, "poisson": 0.3}],
            "indenter": {"shape": "flat", "width_mm": 7.396967767685416,
                         "edge_radius_mm": 1.7391105322451221},
        }
    )  # fmt: skip
    share, size_m = 0.07, 0.07 * 0.5e-3 * scene.indenter.width_mm_projected
    radius_m = 1e-3 * scene.arteries[0].outer_radius_mm

    def at_wall(_: float) -> float:
        return min(max(0.4 * size_m, 0.25 * share * radius_m), 0.8 * share * radius_m)

    grading = Grading(0.15 * size_m, at_wall, 0.35, 0.1e-3 * scene.surface_mm, 5 * share)
    section = build_section(scene, 26.418085606175854e-3, depth_m=0.309467344259828e-3,
                            size_m=size_m, grading=grading)  # fmt: skip
    hollow = pi * (scene.arteries[0].inner_diameter_mm / 2) ** 2
    assert 1e6 * section.cells.weight.sum() == pytest.approx(
        64 * scene.surface_mm - hollow, rel=1e-5
    )
