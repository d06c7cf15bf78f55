"""The force that a modulus is fitted to is that of the place which was pressed."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from probe.calibrate.tissue_force import force_of_modulus, proportional
from sim_backend.models import press as pressing
from sim_backend.scene.scene_file import load_scene


@pytest.mark.parametrize(("asked_mm", "pressed_mm"), [(None, 32.0), (8.0, 8.0)])
def test_a_block_is_pressed_where_it_was(
    monkeypatch: pytest.MonkeyPatch, asked_mm: float | None, pressed_mm: float
) -> None:
    """Near its side a block is softer than in its middle."""
    places_mm = set()

    def noted(_scene: Any, x_mm: float, depth_mm: float, *_more: Any, **_named: Any) -> Any:
        places_mm.add(x_mm)
        return SimpleNamespace(
            states=[SimpleNamespace(force_n=50e3 * depth_mm)], error_estimate_pct=0.2
        )

    monkeypatch.setattr(pressing, "press", noted)
    forward, off = force_of_modulus(load_scene("TI"), 2e-3, x_mm=asked_mm)
    assert places_mm == {pressed_mm}
    force_n, by_modulus = forward(np.array([25e3]), np.array([1e-3]))
    assert force_n == pytest.approx(25e3)  # half of the scene's 50 kPa
    assert by_modulus[:, 0] == pytest.approx(1.0)
    assert off == pytest.approx(0.002)


def test_below_what_was_solved_the_force_goes_straight_on() -> None:
    depths = np.linspace(0.0, 2e-3, 9)[1:]
    forward = proportional(depths, depths**1.5)
    unit = forward(np.array([1.0]), 2e-3 + np.array([-1e-6, 0.0, 1e-3]))[0]
    assert unit[2] - unit[1] == pytest.approx(1e3 * (unit[1] - unit[0]), rel=1e-3)
