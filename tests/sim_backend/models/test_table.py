"""Which model is taken, what it answers, and ramps at one place."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.models.refine import Asked
from sim_backend.models.stations import ramp
from sim_backend.models.table import choose
from sim_backend.scene.scene_file import Scene, SceneError, load_scene


def test_a_gradient_is_known_of_what_was_solved_at_finite_strain_only() -> None:
    asked = Asked(load_scene("TI"), 32e-3, 0.1e-3)
    step_m = 1e-3 * choose(asked, "finite").gradient["depth_mm"][0]
    assert step_m > 0
    with pytest.raises(SceneError, match="no gradient is known of a press by small"):
        _ = choose(asked, "small").gradient


def test_the_dearer_model_follows_where_the_cheaper_one_is_too_rough() -> None:
    """Round blocks within and around a narrow one differ by more than is asked for."""
    scene = Scene.model_validate({
        "name": "narrow", "plane": "solid", "indenter": {"shape": "sphere", "radius_mm": 4.0},
        "tissue": {"width_mm": 12.0, "height_mm": 8.0, "length_mm": 12.0, "modulus_kpa": 50.0,
                   "poisson": 0.45}})  # fmt: skip
    asked = Asked(scene, 6e-3, 0.5e-3)
    rough = choose(asked, "axisymmetric")
    fine = choose(replace(asked, accuracy_pct=0.9 * rough.error_pct[0]))
    assert (rough.model, fine.model) == ("axisymmetric", "solid")
    assert abs(rough.force_n[0] / fine.force_n[0] - 1) < 0.01 * rough.error_pct[0]
    assert "axisymmetric would leave" in fine.why


@pytest.mark.parametrize("bonded", [False, True])
def test_a_ramp_says_at_each_depth_what_presses_say(bonded: bool) -> None:
    """A bonded finger's answer is its path's; two depths alone would be two steps of it."""
    finger = {"shape": "cylinder", "radius_mm": 5.0, "bonded": bonded}
    scene = Scene.model_validate(load_scene("TIHA").model_dump() | {"indenter": finger})
    beat_pa = [10e3, 16e3]
    for solved, depth_m in zip(ramp(scene, 29e-3, [0.5e-3, 1.5e-3], beat_pa),
                               (0.5e-3, 1.5e-3), strict=True):  # fmt: skip
        pressed = choose(Asked(scene, 29e-3, depth_m, beat_pa, accuracy_pct=0.5))
        assert solved.force_n == pytest.approx(pressed.force_n, rel=0.01)
        assert np.ptp(solved.force_n) == pytest.approx(np.ptp(pressed.force_n), rel=0.05)
        assert solved.contact_m[:, :2] == pytest.approx(pressed.contact_m[:, :2], abs=0.3e-3)
