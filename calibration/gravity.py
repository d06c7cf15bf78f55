"""Gravity compensation: what the tool itself weighs on a six-axis sensor.

With R (world from sensor) and g_s = R^T g in the sensor's frame,
    force  = m g_s + force bias          torque = (m c) x g_s + torque bias,
both linear in the unknowns.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, linear_fit

GRAVITY_M_S2 = (0.0, 0.0, -9.80665)
FARTHEST_M = 1.0
"""Of a tool's centre of mass from the sensor: twice the reach of the arm that carries it, a UR3."""
ADVICE = (
    "add orientations whose down direction differs by at least 30 degrees, not all in one plane"
)


@dataclass(frozen=True)
class GravityCalibration:
    """``mass_kg``, ``centre_m`` (3,) in the sensor's frame and the wrench's ``bias`` (6,)."""

    KIND: ClassVar[str] = "gravity"
    UNITS: ClassVar[dict[str, str]] = {
        "mass_kg": "kg",
        "centre_m": "m",
        "bias": "N, N m",
        "gravity_m_s2": "m/s2",
    }
    mass_kg: float
    centre_m: Array
    bias: Array
    gravity_m_s2: Array
    fit: Fit = field(repr=False)

    def load(self, wrench: Array, rotations: Array) -> Array:
        """Contact wrench (n, 6) [N, N m]: ``wrench`` (n, 6) less the tool's weight and the bias.

        ``rotations`` (n, 3, 3) or (3, 3): world from sensor.
        """
        down = np.swapaxes(np.asarray(rotations, dtype=float), -1, -2) @ self.gravity_m_s2
        weight = self.mass_kg * down
        own = np.concatenate([weight, np.cross(self.centre_m, weight)], axis=-1)
        return np.asarray(wrench - self.bias - own)

    def misses(self, wrench: Array, rotations: Array) -> Array:
        """What is left (6 n,) of free-hanging readings."""
        return self.load(wrench, rotations).ravel()


def fit_gravity(
    wrench: Array, rotations: Array, gravity_m_s2: tuple[float, float, float] = GRAVITY_M_S2
) -> GravityCalibration:
    """Mass, centre and bias from free-hanging readings in several orientations.

    ``wrench`` (n, 6) [N, N m], ``rotations`` (n, 3, 3) world from sensor. Raises
    `CalibrationError` when the orientations do not separate weight from bias.
    """
    wrench, turns = np.asarray(wrench, dtype=float), np.asarray(rotations, dtype=float)
    if wrench.ndim != 2 or wrench.shape[1] != 6 or turns.shape != (len(wrench), 3, 3):
        raise CalibrationError(
            f"wrench {wrench.shape} and rotations {turns.shape}: expected (n, 6) and (n, 3, 3)"
        )
    if not (np.isfinite(wrench).all() and np.isfinite(turns).all()):
        raise CalibrationError("a reading or an orientation is not finite; remove it")
    g = np.asarray(gravity_m_s2, dtype=float)
    down = np.swapaxes(turns, 1, 2) @ g
    unit = np.tile(np.eye(3), (len(down), 1))
    by_mass = np.column_stack([down.ravel(), unit])
    force_names = ("mass", "force bias x", "force bias y", "force bias z")
    force = linear_fit(by_mass, wrench[:, :3].ravel(), force_names, ADVICE, weakest=0.05)
    moment = -_cross_matrices(down).reshape(-1, 3)  # (m c) x g_s = -[g_s]x (m c)
    torque_names = tuple(f"{q} {axis}" for q in ("centre", "torque bias") for axis in "xyz")
    torque = linear_fit(
        np.column_stack([moment, unit]), wrench[:, 3:].ravel(), torque_names, ADVICE, weakest=0.05
    )
    mass = float(force.values[0])
    if mass <= 3 * force.sigma[0]:
        raise CalibrationError(
            f"mass {1e3 * mass:.1f} g +- {1e3 * force.sigma[0]:.1f} g: not distinguishable from 0; "
            "check the frame of the orientations, or mount a heavier tool"
        )
    centre = torque.values[:3] / mass
    if (away_m := float(np.linalg.norm(centre))) > FARTHEST_M:
        raise CalibrationError(
            f"the centre of mass would be {away_m:.3g} m from the sensor, and {FARTHEST_M:g} m is "
            "the most that is possible: moments must be in N m (not N mm), forces in N"
        )
    covariance = np.zeros((10, 10))
    covariance[:4, :4], covariance[4:, 4:] = force.covariance, torque.covariance
    both = Fit((), np.empty(0), covariance, np.concatenate([force.residuals, torque.residuals]), 0)
    jacobian = np.zeros((10, 10))  # to mass, centre, force bias, torque bias
    jacobian[0, 0] = 1
    jacobian[1:4, 0], jacobian[1:4, 4:7] = -centre / mass, np.eye(3) / mass
    jacobian[4:7, 1:4], jacobian[7:, 7:] = np.eye(3), np.eye(3)
    bias = np.concatenate([force.values[1:], torque.values[3:]])
    names = (force_names[0], *torque_names[:3], *force_names[1:], *torque_names[3:])
    fit = both.derived(names, np.concatenate([[mass], centre, bias]), jacobian)
    fit = Fit(fit.names, fit.values, fit.covariance, fit.residuals, min(force.dof, torque.dof))
    return GravityCalibration(mass, centre, bias, g, fit)


def _cross_matrices(v: Array) -> Array:
    """[v]x (n, 3, 3) with [v]x w = v x w."""
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
