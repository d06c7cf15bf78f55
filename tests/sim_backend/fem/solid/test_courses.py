"""Vessels on a path: where they lie, what they hold, and that they are felt as they must be."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_solid import small_solid

from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.build import build_body, half_width_m
from sim_backend.fem.solid.courses import lean
from sim_backend.fem.solid.forces import unit_pressure
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.models.solid_meshes import SHARES
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

INNER_MM, OUTER_MM = 2.25, 2.88
VESSEL = {"kind": "artery", "x_mm": 12.0, "depth_mm": 6.5, "inner_diameter_mm": 2 * INNER_MM,
          "wall_mm": OUTER_MM - INNER_MM, "modulus_kpa": 400.0, "poisson": 0.45}  # fmt: skip
OBLIQUE = [(-12.0, 8.0, 7.5), (12.0, 16.0, 5.5)]
LUMP = {"kind": "tumour", "x_mm": 20.8, "depth_mm": 6.0, "z_mm": -4.0, "diameter_mm": 3.0,
        "modulus_kpa": 500.0, "poisson": 0.45}  # fmt: skip


def block(*inclusion: dict[str, Any], ends: str = "free") -> Scene:
    return small_solid(24.0, 24.0, *inclusion, height_mm=12.0, ball_mm=5.0, ends=ends)


def body_of(*inclusion: dict[str, Any], ends: str = "free") -> SolidBody:
    return build_body(block(*inclusion, ends=ends), 12e-3, depth_m=1e-3, size_m=2.5e-3)


def test_an_oblique_vessel_is_a_round_tube() -> None:
    """Wall, block and lump keep their volumes and places."""
    body = body_of(VESSEL | {"path": OBLIQUE}, LUMP)
    nodes, cells = 1e3 * body.wedges.nodes, body.wedges.cells
    start, end = (np.array([x, 12.0 - depth, z]) for z, x, depth in OBLIQUE)
    along = (end - start) / np.linalg.norm(end - start)

    def away(which: np.ndarray) -> np.ndarray:
        off = nodes[np.unique(cells[which])] - start
        return np.linalg.norm(off - (off @ along)[:, None] * along, axis=1)

    wall = away(body.region == 1)
    assert wall.min() == pytest.approx(INNER_MM) and wall.max() == pytest.approx(OUTER_MM)
    assert away(body.region == 0).min() > INNER_MM
    volume = {k: 1e9 * float(body.wedges.weight[body.region == k].sum()) for k in range(4)}
    tube = np.pi * 24.0 / along[2]
    assert volume[1] == pytest.approx(tube * (OUTER_MM**2 - INNER_MM**2), rel=2e-3)
    assert volume[3] == pytest.approx(np.pi / 6 * 27, rel=0.03)
    assert sum(volume.values()) == pytest.approx(24 * 12 * 24 - tube * INNER_MM**2, rel=1e-4)
    centre = nodes[np.unique(cells[body.region == 3])].mean(axis=0)
    np.testing.assert_allclose(centre, [20.8, 6.0, -4.0], atol=0.05)


def test_what_leaves_through_free_ends_turns_the_block_by_nothing() -> None:
    body = body_of(VESSEL | {"path": OBLIQUE})
    nodes = body.wedges.nodes
    wall = np.zeros(body.size)
    for faces in body.lumens:
        np.add.at(wall, faces.dofs, unit_pressure(faces, nodes)[0])
    scale = np.pi * (1e-3 * INNER_MM) ** 2

    def moment(force: np.ndarray) -> np.ndarray:
        return np.cross(nodes - nodes.mean(axis=0), force.reshape(-1, 3)).sum(axis=0)

    assert np.abs((wall + body.thrust).reshape(-1, 3).sum(axis=0)).max() < 1e-3 * scale
    assert np.linalg.norm(moment(wall)) > 7e-3 * scale
    assert np.linalg.norm(moment(wall + body.thrust)) < 1e-5 * scale
    assert not body_of(VESSEL | {"path": OBLIQUE}, ends="held").thrust.any()
    assert not body_of(VESSEL).thrust.any()


def test_at_the_ends_of_a_path_the_vessel_leans_as_before_them() -> None:
    one = Artery.model_validate(VESSEL | {"path": [(-4.0, 10.0, 6.0), (0.0, 12.0, 6.0),
                                                   (4.0, 12.0, 7.0)]})  # fmt: skip
    np.testing.assert_allclose(lean(one, -4.0), [0.5, 0.0])
    np.testing.assert_allclose(lean(one, 0.0), [0.25, -0.125])
    np.testing.assert_allclose(lean(one, 4.0), [0.0, -0.25])
    np.testing.assert_allclose(lean(one, 4.1), [0.0, 0.0])


def test_under_a_ball_an_oblique_vessel_is_felt_as_a_straight_one() -> None:
    """Both are whole blocks of the same elements, bent otherwise."""
    levels = [0.0, 80 * PA_PER_MMHG]
    straight, oblique = (
        [one.force_n for one in solve_solid(block(VESSEL | {"path": path}), 12e-3, 1e-3, levels,
                                            2.5e-3)[1]]
        for aside in (0.01, 12 * float(np.tan(np.radians(25.0))))
        for path in ([(-12.0, 12.0 - aside, 6.5), (12.0, 12.0 + aside, 6.5)],)
    )  # fmt: skip
    np.testing.assert_allclose(oblique, straight, rtol=0.01)
    assert np.ptp(oblique) == pytest.approx(np.ptp(straight), rel=0.02)


@pytest.mark.timeout(900)
def test_a_vessel_that_dips_is_felt_as_calculix_says() -> None:
    """Hexahedra that were moved up and down by straight lines (tests/data/presses)."""
    kept = Path(__file__).parents[3] / "data" / "presses" / "vessel-on-a-path.json"
    solved = json.loads(kept.read_text("utf-8"))
    scene = Scene.model_validate(solved["scene"])
    levels = [p * PA_PER_MMHG for p in solved["pressures_mmhg"]]
    size_m = SHARES[0] * half_width_m(scene)
    _, states = solve_solid(scene, 12e-3, 1e-3 * solved["depth_mm"], levels, size_m)
    force_n = [one.force_n for one in states]
    np.testing.assert_allclose(force_n, solved["force_n"], rtol=0.02)
    np.testing.assert_allclose(np.diff(force_n), np.diff(solved["force_n"]), rtol=0.02)
