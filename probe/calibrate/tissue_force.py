"""The force of a press on plain tissue, as a function of its modulus: what a fit compares with."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from calibration.errors import CalibrationError
from drivers.core.arrays import Array
from sim_backend.scene.scene_file import Scene

Forward = Callable[[Array, Array], tuple[Array, Array]]

CURVE_POINTS = 11
KNOWN = 1.1
"""How deep the force is solved, over the deepest reading: a surface may lie above the first."""


def force_of_modulus(
    scene: Scene, deepest_m: float, model: str | None = None, x_mm: float | None = None
) -> tuple[Forward, float]:
    """Force (n,) [N] of moduli (1,) [Pa] and depths (n,) [m] on plain tissue, with its derivative
    (n, 1), by the finite elements: a homogeneous block's force is proportional to its modulus. And
    by how much all forces may be off together: the share that the presses state.

    Known a tenth deeper than ``deepest_m``, and straight on below. Pressed at ``x_mm`` of the
    block, by default in its middle. A solid's block under a round finger is solved as a body of
    revolution."""
    from sim_backend.models.press import press  # finite elements: for nothing else here
    from sim_backend.models.refine import Asked
    from sim_backend.models.table import steady

    if scene.tissue is None:
        raise CalibrationError(f"scene {scene.name} has no tissue")
    depths = KNOWN * deepest_m * np.linspace(0.0, 1.0, CURVE_POINTS)[1:] ** 1.5
    width_mm = scene.tissue.width_mm
    x_mm = 0.5 * width_mm if x_mm is None else x_mm
    if not 0 < x_mm < width_mm:
        raise CalibrationError(f"pressed at x = {x_mm:g} mm; the scene's block is {width_mm:g} mm "
                               "wide, from 0")  # fmt: skip
    # of a body of revolution the block's outline alone leaves 1 %
    entry = steady(Asked(scene, 1e-3 * x_mm, float(depths[-1]), (0.0,)), model or "auto")
    empty = (0.0,)
    pressed = [press(scene, x_mm, 1e3 * d, empty, model=entry.name,
                     accuracy_pct=entry.usual_pct) for d in depths]  # fmt: skip
    force_n = np.array([one.states[0].force_n for one in pressed])
    off = 1e-2 * max(np.array([one.error_estimate_pct for one in pressed]) * force_n) / max(force_n)
    return proportional(depths, force_n / (1e3 * scene.tissue.modulus_kpa)), off


def proportional(depths: Array, force_per_pa: Array) -> Forward:
    """The forward model through forces per modulus (k,) at ``depths`` (k,) > 0, none in the air.

    The force over the depth is interpolated: it varies little. Below them it goes straight on.
    """
    slope = CubicSpline(depths, force_per_pa / depths)
    last = float(slope(depths[-1]) + depths[-1] * slope(depths[-1], 1))

    def forward(moduli: Array, depth_m: Array) -> tuple[Array, Array]:
        sunk = np.clip(depth_m, 0.0, depths[-1])
        unit = sunk * slope(np.maximum(sunk, depths[0])) + last * np.maximum(depth_m - sunk, 0.0)
        return moduli[0] * unit, unit[:, None]

    return forward
