"""Quick presses beside the full model."""

import numpy as np
import pytest
from changed_scene import changed
from soft_walls import soft_walled

from sim_backend import load_scene
from sim_backend.fem.newton import CannotSolve, NotConverged
from sim_backend.models import quick
from sim_backend.models.place import place
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

SCENES = {name: load_scene(name) for name in ("TI", "TIT", "TIHA", "TISA")}
FLAT = {"shape": "flat", "width_mm": 8.0, "edge_radius_mm": 1.0}
STICKS = {"shape": "cylinder", "radius_mm": 5.0, "bonded": True}


@pytest.mark.parametrize("scene", [
    *SCENES.values(), changed("TIHA", plane="strain"), changed("TIHA", indenter=FLAT),
    changed("TIHA", indenter=STICKS), load_scene("HAOT"),
], ids=[*SCENES, "plane strain", "flat finger", "bonded finger", "lone vessel"])  # fmt: skip
def test_a_quick_press_is_as_near_as_it_states(scene: Scene) -> None:
    x_mm, depth_mm = (32.0, 1.0) if scene.tissue is None else (24.0, 2.5)
    ends = (scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg) if scene.arteries else (0.0,)
    ours = press(scene, x_mm, depth_mm, ends, model="quick")
    truth = press(scene, x_mm, depth_mm, ends, model="finite", accuracy_pct=0.5)
    off_pct = 100 * np.abs(
        np.array([s.force_n for s in ours.states]) / [s.force_n for s in truth.states] - 1
    )
    allowed_pct = ours.force_error_estimate_pct + truth.force_error_estimate_pct
    assert off_pct.max() <= allowed_pct <= (3.0 if scene.tissue else 8.0)
    if scene.arteries:
        off_n = abs(ours.pulse_n - truth.pulse_n)
        assert off_n <= ours.pulse_error_n + truth.pulse_error_n <= 0.1 * truth.pulse_n


@pytest.mark.parametrize("x_mm", [24.0, 32.0])
def test_over_a_wall_that_nearly_bursts_the_pulse_is_known_as_well_as_stated(x_mm: float) -> None:
    scene = soft_walled(164.0, 26.9, modulus_kpa=140.0, wall_mm=0.363, depth_mm=9.17)
    ours, truth = (press(scene, x_mm, 1.48, [80.0, 164.0], model=m) for m in ("quick", "finite"))
    assert abs(ours.pulse_n - truth.pulse_n) <= ours.pulse_error_n


def test_where_the_guess_fails_the_finger_is_lowered(monkeypatch: pytest.MonkeyPatch) -> None:
    def solved() -> float:
        return place(SCENES["TIHA"], 28e-3).solve(2e-3, [12e3], model="quick").force_n[0]

    guessed, lowered, down = solved(), [], quick.down

    def fails(*_: object) -> None:
        raise NotConverged("elements were crushed")

    monkeypatch.setattr(quick, "equilibrium", fails)
    monkeypatch.setattr(quick, "down", lambda *given: (lowered.append(1), down(*given))[1])
    assert solved() == pytest.approx(guessed, rel=1e-6)
    assert lowered


def test_a_vessel_that_bursts_says_so() -> None:
    thin = {"modulus_kpa": 5.0, "wall_mm": 0.2}
    burst = changed("TIHA", inclusion=thin, tissue={"modulus_kpa": 2.0})
    with pytest.raises(CannotSolve, match="mmHg"):
        place(burst, 32e-3).solve(2.5e-3, [100 * PA_PER_MMHG], model="quick")
