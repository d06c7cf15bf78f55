"""A modulus from a ball's press: the truth is not solved by the model that is fitted."""

import numpy as np
import pytest
from own_scene import BALL
from scipy.interpolate import CubicSpline

from calibration.tissue import fit_tissue
from probe.calibrate import tissue_force
from sim_backend.scene.scene_file import scene_from_text

# On 30 kPa, by `palpate press --model solid --accuracy 3` (wedges in space, the whole block) but
# for the last, which is CalculiX' (C3D15, 12,465 unknowns: 0.5770 N on 50 kPa).
DEPTHS_M = 1e-3 * np.array([0.25, 0.5, 1.0, 1.5, 2.0])
FORCES_N = np.array([0.015519, 0.043528, 0.122135, 0.227134, 0.6 * 0.576957])


def test_the_modulus_is_that_of_the_block_in_space(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tissue_force, "CURVE_POINTS", 5)
    depth_m = np.linspace(0.25e-3, 2e-3, 60)
    force_n = CubicSpline(DEPTHS_M, FORCES_N / DEPTHS_M**1.5)(depth_m) * depth_m**1.5
    scene = scene_from_text(BALL.format(modulus_kpa=50.0), "ball")
    forward, _ = tissue_force.force_of_modulus(scene, 2e-3)
    found = fit_tissue(depth_m, force_n, forward, [10e3], find_surface=False)
    assert found.modulus_pa[0] == pytest.approx(30e3, rel=0.02)
