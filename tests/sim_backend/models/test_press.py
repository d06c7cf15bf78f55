"""One press: what is chosen, what is said about its error, and where it is refused."""

import numpy as np
import pytest
from small_block import BLOCK

from sim_backend.fem.finite_strain import solve_finite
from sim_backend.models import section_meshes
from sim_backend.models.press import CannotSolve, press
from sim_backend.scene.scene_file import load_scene
from sim_backend.scene.waves import PA_PER_MMHG
from tests.support.full_model import FullModel

BEAT = (80.0, 120.0)


def true_errors_pct(pressed) -> tuple[float, float]:
    """Of force and of the span over the pressures, against elements of 0.35 mm."""
    levels = [s.pressure_mmhg * PA_PER_MMHG for s in pressed.states]
    place = 1e-3 * pressed.x_mm, 1e-3 * pressed.depth_mm
    _, found = solve_finite(pressed.scene, *place, levels, 0.35e-3)
    ours = np.array([s.force_n_per_mm for s in pressed.states])
    truth = 1e-3 * np.array([one.force_n_per_m for one in found])
    span = np.ptp(truth) or np.inf
    return (100 * np.abs(ours / truth - 1).max(), 100 * abs(np.ptp(ours) - np.ptp(truth)) / span)


@pytest.mark.parametrize("name", ["TIHA", "TISA"])
def test_the_stated_errors_hold(name):
    """TISA's pulse is a four-hundredth of the force, and still has its own error."""
    pressed = press(load_scene(name), 32.0, 2.5, BEAT, accuracy_pct=5.0)
    force_pct, pulse_pct = true_errors_pct(pressed)
    assert force_pct <= 2 * pressed.error_estimate_pct
    assert pulse_pct <= 2 * pressed.pulse_error_estimate_pct
    assert pressed.pulse_error_estimate_pct <= pressed.error_estimate_pct <= 5.0


def test_a_single_pressure_has_no_pulse():
    reported = press(load_scene("TI"), 32.0, 1.0, accuracy_pct=5.0).as_json()
    assert reported["pulse_error_estimate_pct"] is None


def test_one_pressure_may_be_given_as_a_number():
    pressed = press("TIHA", 32.0, 1.0, 100, model="small", accuracy_pct=10.0)
    assert [one.pressure_mmhg for one in pressed.states] == [100.0]


def test_small_strain_counts_its_own_error():
    pressed = press(load_scene("TI"), 32.0, 1.2, model="small")
    force_pct, _ = true_errors_pct(pressed)
    assert 1.0 < force_pct <= 2 * pressed.error_estimate_pct


def test_small_strain_is_refused_where_it_is_nonsense():
    with pytest.raises(CannotSolve, match=r"small strain misses about 18 % .* 2\.5 mm deep"):
        press(load_scene("TI"), 32.0, 2.5, model="small")


def test_no_mesh_is_larger_than_what_is_allowed(monkeypatch):
    allowed = 3000
    monkeypatch.setattr(section_meshes, "MAX_UNKNOWNS", allowed)
    pressed = press(load_scene("TI"), 32.0, 1.0, accuracy_pct=0.02)
    assert 0.5 * allowed < pressed.dofs < 1.2 * allowed
    assert pressed.error_estimate_pct > 0.02


def test_what_a_small_pulse_is_off_by_does_not_vanish_with_it():
    low, high = 80.0, 80.01
    pressed = press(BLOCK, 12.0, 1.0, (low, high), accuracy_pct=5.0)
    force_n = max(state.force_n for state in pressed.states)
    assert pressed.pulse_n < 1e-4 * force_n
    off_n = 1e-5 * pressed.pulse_error_estimate_pct * force_n
    assert pressed.pulse_error_n == pytest.approx(off_n)
    model = FullModel(BLOCK, 12e-3, 5.0)
    levels_pa = low * PA_PER_MMHG, high * PA_PER_MMHG
    assert float(model.pulse_error_n(1e-3, *levels_pa)) == pytest.approx(off_n)
    assert float(model.error_n(1e-3, levels_pa[0])) == pytest.approx(
        0.01 * pressed.force_error_estimate_pct * force_n, rel=1e-2
    )
    assert press(BLOCK, 12.0, 1.0, (low,), accuracy_pct=5.0).pulse_error_n is None
