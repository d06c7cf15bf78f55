import math
from typing import Any

import numpy as np
import pytest
from changed_scene import changed

from drivers import SimulatedClock
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.slicing import section_at

MOVE = (2.5e-3, 1e3)  # speed, and an acceleration so high that the speed is constant


def phantom(winkler: Any, scene: Scene, **more: Any) -> Phantom:
    made = Phantom(scene, SimulatedClock(), winkler, home=(0.032, 0.0, 0.0), **more)
    made.tip.move(1.0, (0.032, 0.0, -2.5e-3), *MOVE)
    return made


def noting(winkler: Any) -> tuple[Any, list[float]]:
    """An answer that keeps to which depths [m] it was asked, rounded as finite elements do."""
    asked: list[float] = []

    def respond(scene: Scene, x_m: float, max_depth_m: float) -> Any:
        asked.append(round(max_depth_m, 9))
        return winkler(scene, x_m, max_depth_m)

    return respond, asked


def test_depth_follows_the_ramp(winkler: Any) -> None:
    world = phantom(winkler, load_scene("TIHA"))
    assert world.depth_m(np.array([0.5, 1.5, 2.0, 5.0])) == pytest.approx(
        [0, 1.25e-3, 2.5e-3, 2.5e-3], abs=1e-8
    )


def test_the_beat_starts_with_the_hold_and_ends_in_the_air(winkler: Any) -> None:
    world = phantom(winkler, load_scene("TIHA"))
    world.tip.move(4.0, (0.032, 0.0, 5e-3), 20e-3, 1e3)
    mmhg = world.pressure_pa(np.array([0.5, 1.9, 2.1, 2.4, 2.0 + 0.825 + 0.1, 6.0])) / 133.322
    assert mmhg == pytest.approx([90, 90, 120, 80, 120, 90], abs=0.1)


def test_a_free_pulse_beats_always_and_its_phase_is_the_seeds(winkler: Any) -> None:
    free = changed("TIHA", pulse={"start": "free"})
    t = np.linspace(0, 0.825, 100)
    one, same, other = (phantom(winkler, free, seed=s).pressure_pa(t) for s in (1, 1, 2))
    assert np.ptp(one) == pytest.approx(40 * 133.322, rel=0.01)
    assert (one == same).all()
    assert not np.allclose(one, other)


def test_relaxation_loses_the_prony_weights_of_a_held_force(winkler: Any) -> None:
    g, tau_s = 0.3, 0.5
    soft = changed("TI", tissue={"relaxation": ((g, tau_s),)})
    t = np.array([1.5, 2.0, 2.5, 12.0])
    force_n = phantom(winkler, soft).force_n(t)
    # A ramp of rate r: F = r k [(1 - g) t + g tau (1 - exp(-t/tau))];
    # from its end on the last term decays.
    rate_n_s = 400 * 2.5e-3
    arm = g * tau_s * (1 - math.exp(-1 / tau_s))
    expected = [
        rate_n_s * ((1 - g) * 0.5 + g * tau_s * (1 - math.exp(-0.5 / tau_s))),
        rate_n_s * ((1 - g) + arm),
        rate_n_s * ((1 - g) + arm * math.exp(-0.5 / tau_s)),
        rate_n_s * (1 - g),
    ]
    assert force_n == pytest.approx(expected, rel=2e-3)


def test_deeper_than_prepared_is_solved_again(winkler: Any) -> None:
    respond, asked = noting(winkler)

    world = Phantom(load_scene("TI"), SimulatedClock(), respond, depth_m=1e-3, home=(0.02, 0, 0))
    world.tip.move(0.0, (0.02, 0.0, -2e-3), *MOVE)
    world.force_n(np.linspace(0, 1, 50))
    assert max(asked) >= 2e-3
    assert len(asked) <= 2


def test_a_sphere_is_cut_to_its_chord_and_a_path_is_followed() -> None:
    scene = Scene.model_validate(
        {
            "name": "both",
            "tissue": {"width_mm": 64, "height_mm": 16.83, "modulus_kpa": 50, "poisson": 0.49},
            "inclusion": [
                {
                    "kind": "tumour", "x_mm": 12, "depth_mm": 6, "diameter_mm": 6,
                    "modulus_kpa": 1000, "poisson": 0.49, "z_mm": 10,
                },
                {
                    "kind": "artery", "x_mm": 40, "depth_mm": 10, "inner_diameter_mm": 4.5,
                    "wall_mm": 0.6, "modulus_kpa": 400, "poisson": 0.49,
                    "path": [[0, 40, 10], [20, 44, 12]],
                    "stenosis": {"fraction": 0.3, "modulus_kpa": 4000, "z_mm": [5, 15]},
                },
            ],
        }
    )  # fmt: skip
    lump, vessel = section_at(scene, 11.0).inclusion
    assert lump.outer_radius_mm == pytest.approx(math.sqrt(9 - 1))
    assert (vessel.x_mm, vessel.depth_mm) == pytest.approx((42.2, 11.1))
    assert vessel.kind == "artery"
    assert vessel.stenosis is not None
    (only,) = section_at(scene, 0.0).inclusion
    assert only.kind == "artery"
    assert only.stenosis is None
    assert section_at(load_scene("TIHA"), 3.0) is not None


@pytest.mark.parametrize("home", [(0.004, 0.0, 2e-3), (0.0, 0.004, 2e-3)])
def test_depth_is_along_the_normal(winkler: Any, home: tuple[float, float, float]) -> None:
    """1 mm straight down from a slope of 3 in 4, along x or along y, is 0.8 mm deep."""
    along = 0 if home[0] else 1
    sloping = Phantom(
        load_scene("TI"), SimulatedClock(), winkler, surface=lambda *at: 0.75 * at[along],
        home=home,
    )  # fmt: skip
    assert sloping.depth_m(np.zeros(1)) == pytest.approx(0.8e-3)


def test_a_drag_is_answered_by_the_section_and_the_surface_under_each_place(winkler: Any) -> None:
    scene, slope = load_scene("TIT"), 0.05
    world = Phantom(
        scene, SimulatedClock(), winkler, surface=lambda x, _y: slope * (x - 0.032),
        home=(0.024, 0.0, -2e-3),
    )  # fmt: skip
    world.tip.move(1.0, (0.034, 0.0, -2e-3), *MOVE)
    x_m = np.array([0.026, 0.029, 0.030, 0.032])
    depth_m = (2e-3 + slope * (x_m - 0.032)) / math.hypot(1.0, slope)
    expected = [
        winkler(scene, x, 3e-3).force_n(np.array([d]), np.zeros(1))[0]
        for x, d in zip(x_m, depth_m, strict=True)
    ]
    force_n = world.force_n(1.0 + (x_m - 0.024) / MOVE[0])
    assert force_n == pytest.approx(expected, rel=1e-4)


def test_a_section_is_solved_as_deep_as_it_is_pressed(winkler: Any) -> None:
    respond, asked = noting(winkler)
    made = Phantom(load_scene("TI"), SimulatedClock(), respond, home=(0.032, 0.0, 0.0))
    made.tip.move(0.0, (0.032, 0.0, -2.5000004e-3), *MOVE)
    made.force_n(np.linspace(0, 2, 50))
    assert asked[-1] >= 2.5000004e-3
    assert asked[0] <= 2.501e-3


def test_a_press_as_deep_as_planned_is_solved_once(winkler: Any) -> None:
    respond, asked = noting(winkler)
    depth_m, end_s = 2.5e-3, 1.0025
    made = Phantom(
        load_scene("TI"), SimulatedClock(), respond, depth_m=depth_m, home=(0.032, 0.0, 0.0)
    )
    made.tip.move(0.0, (0.032, 0.0, -depth_m), 2.5e-3, 1.0)
    time_s = np.concatenate([[0.5], np.linspace(end_s - 1e-5, end_s, 2000)])
    assert made.depth_m(time_s).max() > depth_m  # by a last digit
    made.force_n(time_s[:1])
    made.force_n(time_s[1:])
    assert asked == pytest.approx([depth_m])
