"""What may lie beneath a row, each with its parameters, what they may be, and its words.

A parameter of a `sim_backend.touch` kind is in units of finger and tissue; pressures are in mmHg
here, since the tissue's modulus is a parameter too.
"""

import numpy as np

from drivers.core.arrays import Array, Bools
from probe.detection.beneath.posterior import Model
from probe.detection.beneath.row_data import RowData
from sim_backend.touch.kinds import LUMP, VESSEL, Kind
from sim_backend.touch.table import AtDepths, TouchTable

PA_PER_MMHG = 133.322387415
PRESSURES = {"pressure": (60.0, 100.0), "swing": (20.0, 62.0)}
"""Diastole and pulse pressure of most adults [mmHg], each evenly (ESC/ESH 2018, table 3, from
optimal to grade 2)."""
TISSUE_PA = (2e3, 500e3)
"""Fat to tight muscle (Wells & Liang 2011, table 1), each decade alike."""
TILT, BOW_M, OFFSET_M = 0.01, 50e-6, 50e-6
"""How far a surface is tilted, bent and off its height from where the rig takes it to be: stages
and jigs on a bench; a touch before each press leaves less."""
REPEATABILITY_M = 10e-6
ZERO_N = 2e-3
GAIN = 0.3
"""Of each depth, in all presses alike: relaxing tissue presses back less at each step of the ramp,
in proportion to its stiffness (117 curves on meat lose 28 % in 0.8 s)."""
MODEL, MODEL_OF_BUMP, MODEL_OF_PULSE = 0.002, 0.015, 0.08
"""What finite elements are off by, of the force, of a bump, and of a pulse from beat to beat."""
REACH, REACH_SUNK = 0.6, 0.25
"""Half widths, along the row and in depth, over which a table's errors are alike: in 60 rows over
random bodies their correlation is 0.4 at 0.8 and 0 at 1.6 along it, 0.6 at 0.25 in depth."""


HYPOTHESES: dict[str, Kind] = {
    "tumour": LUMP,
    "artery": VESSEL,
    "stenotic artery": VESSEL,
}
"""By the name of an object. Every vessel may be narrowed, by as little as nothing: one row hardly
tells, and a depth that relies on a healthy one is wrong over a narrowed one."""


def names_of(kind: Kind) -> tuple[str, ...]:
    """Of the parameters of a point: the tissue's modulus, and those of the body."""
    return ("log_modulus", *kind.parameters)


class Likelihood:
    """Of the data of one row over a known block, for any kind of body.

    It compares logarithms of forces, and pulses over forces: what relaxes takes the same share of
    all of them. ``middle_m`` is the block's middle in the scan's frame. What nobody knows of
    surface, zero and relaxation enters as columns with a Gaussian prior each, which makes the noise
    correlated.
    """

    def __init__(
        self, data: RowData, table: TouchTable, half_width_m: float, length_m: float,
        middle_m: float,
    ) -> None:  # fmt: skip
        self.data, self.table = data, table
        self.half_width_m, self.length_m = half_width_m, length_m
        self.x = (data.x_m - middle_m) / half_width_m
        self.sunk = data.sunk_m / half_width_m
        places, depths = np.meshgrid(self.x, self.sunk, indexing="ij")
        bare = table.bare_force(places.ravel(), depths.ravel()).reshape(places.shape)
        self.bare = bare * half_width_m * length_m  # over a modulus
        self.at_depths: dict[str, AtDepths] = {
            name: ratios.at_depths(self.sunk) for name, ratios in table.ratios.items()
        }
        self.measured = np.append(np.log(data.force_n).ravel(), data.pulse_n / data.force_n[:, -1])

    def predicted(self, kind: Kind, theta: Array) -> Array:
        """Logarithms of forces, and pulses over forces (m, n d + n), of ``theta`` (m, 1 + free)."""
        bump, pulse = self._ratios(kind, theta)
        log_force = theta[:, 0][:, None, None] + np.log(self.bare) + np.log(np.maximum(bump, 1e-3))
        return np.hstack([log_force.reshape(len(theta), -1), (pulse / bump)[..., -1]])

    def _ratios(self, kind: Kind, theta: Array) -> tuple[Array, Array]:
        """Force with a body and its pulse over the bare block's force (m, n, d)."""
        ratio = self.at_depths[kind.name](self.x, self.body(kind, theta))
        return 1 + ratio[..., 0], ratio[..., 1]

    def body(self, kind: Kind, theta: Array) -> Array:
        """The kind's parameters (m, p), in its units."""
        body = theta[:, 1:].copy()
        for name in PRESSURES:
            if name in kind.parameters:
                body[:, kind.parameters.index(name)] *= PA_PER_MMHG / np.exp(theta[:, 0])
        return body

    def model(self, kind: Kind, about: Array | None = None) -> Model:
        """With the errors that a table has ``about`` some point (1 + free,)."""
        root, log_det = self._root(kind, about)
        count = len(self.measured)
        low, high = self._box(kind)
        height = float(self.table.about["height"])

        def misfit(theta: Array) -> Array:
            return (self.measured - self.predicted(kind, theta)) @ root.T

        def allowed(theta: Array) -> Bools:
            return kind.fits(self.body(kind, theta), height)

        starts = self._starts(kind, low, high) if about is None else about[None]
        log_norm = -0.5 * (log_det + count * np.log(2 * np.pi))
        return Model(low, high, misfit, allowed, log_norm, starts)

    def _box(self, kind: Kind) -> tuple[Array, Array]:
        low, high = (np.log(end) for end in TISSUE_PA)
        ranges = [(low, high)]
        for name, first, last in zip(kind.parameters, kind.low, kind.high, strict=True):
            if name == "x":
                first, last = max(first, self.x.min()), min(last, self.x.max())
            ranges.append(PRESSURES.get(name, (first, last)))
        return np.array(ranges).T[0], np.array(ranges).T[1]

    def _starts(self, kind: Kind, low: Array, high: Array) -> Array:
        """Under the station that is farthest above its neighbours, shallow and deep, small and
        large."""
        force = self.data.force_n[:, -1]
        over = force / np.median(force) - 1 + 3 * self.data.pulse_n / np.median(force)
        modulus = np.log(np.median(self.data.force_n[:, -1] / self.bare[:, -1]))
        starts = []
        shares = (0.2, 0.6)
        for depth_share in shares:
            for size_share in shares:
                start = 0.5 * (low + high)
                start[0] = np.clip(modulus, low[0], high[0])
                for k, name in enumerate(names_of(kind)):
                    if name == "x":
                        start[k] = self.x[int(np.argmax(over))]
                    if name == "depth":
                        start[k] = low[k] + depth_share * (high[k] - low[k])
                    if name.endswith(("diameter", "inner")):
                        start[k] = low[k] + size_share * (high[k] - low[k])
                starts.append(start)
        return np.array(starts)

    def _root(self, kind: Kind, about: Array | None) -> tuple[Array, float]:
        """The inverse of the covariance's Cholesky factor, and the covariance's log determinant."""
        data, n = self.data, len(self.x)
        slope, force = data.slope_n_per_m, data.force_n
        x_m = data.x_m - data.x_m.mean()
        half_m = max(float(np.abs(x_m).max()), 1e-6)
        steep = slope / force
        columns = [
            steep * TILT * x_m[:, None],
            steep * BOW_M * (x_m[:, None] / half_m) ** 2,
            steep * OFFSET_M,
            ZERO_N / force,
            *(GAIN * np.ones_like(force) * (np.arange(force.shape[1]) == k)
              for k in range(force.shape[1])),
            *(REPEATABILITY_M * steep * (np.arange(n) == k)[:, None] for k in range(n)),
        ]  # fmt: skip
        of_force = np.array([one.ravel() for one in columns]).T
        known = np.vstack([of_force, np.zeros((n, of_force.shape[1]))])
        variance = np.append(
            (data.force_sd_n / force) ** 2 + MODEL**2,
            (data.pulse_sd_n**2 + (MODEL_OF_PULSE * data.pulse_n) ** 2) / force[:, -1] ** 2,
        )
        covariance = np.diag(variance) + known @ known.T
        if about is not None:
            covariance += self._of_table(kind, about)
        lower = np.linalg.cholesky(covariance)
        root = np.linalg.inv(lower)
        return root, 2 * float(np.log(np.diag(lower)).sum())

    def _of_table(self, kind: Kind, about: Array) -> Array:
        """Covariance of a table's errors about a point: alike over `REACH` and at all depths."""
        off = self.table.ratios[kind.name].off_by(self.body(kind, about[None]))[0]
        near = np.exp(-0.5 * ((self.x[:, None] - self.x) / REACH) ** 2)
        near_sunk = np.exp(-0.5 * ((self.sunk[:, None] - self.sunk) / REACH_SUNK) ** 2)
        ratio = self._ratios(kind, about[None])[0][0]
        bump = (np.hypot(off[0], MODEL_OF_BUMP * (ratio - 1)) / ratio).ravel()
        pulse = off[1] / ratio[:, -1]
        n, depths = self.bare.shape
        found = np.zeros((n * depths + n, n * depths + n))
        found[: n * depths, : n * depths] = bump[:, None] * bump * np.kron(near, near_sunk)
        found[n * depths :, n * depths :] = pulse[:, None] * pulse * near
        return found
