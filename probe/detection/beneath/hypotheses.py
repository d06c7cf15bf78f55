"""What may lie beneath a row, each with its parameters, what they may be, and its words.

A parameter of a `sim_backend.touch` kind is in units of finger and tissue; pressures are in mmHg
here, since the tissue's modulus is a parameter too.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from drivers.core.arrays import Array, Bools
from probe.detection.beneath.nuisance import nuisance
from probe.detection.beneath.posterior import Model, Posterior
from probe.detection.beneath.row_data import RowData
from probe.detection.priors import DEFAULT, Priors
from sim_backend.scene.scene_file import Scene
from sim_backend.touch.kinds import BLOCK, KINDS, Kind
from sim_backend.touch.table import AtDepths, TouchTable, block_of

PA_PER_MMHG = 133.322387415
PRESSURES = ("pressure", "swing")
"""Diastole and pulse pressure [mmHg]."""
OF_PRESSURES = ("log_pressure", "swing")
"""What follows from those for a vessel: diastole over the tissue's modulus, and pulse pressure over
diastole."""
MODEL, MODEL_OF_BUMP, MODEL_OF_PULSE = 0.002, 0.015, 0.08
"""What finite elements are off by, of the force, of a bump, and of a pulse from beat to beat."""
REACH, REACH_SUNK = 1.5, 0.25
"""Half widths, along the row and in depth, over which a table's errors are alike: in 20 rows over
random bodies their correlation is 0.63 at 0.8, 0.33 at 1.6 and 0.18 at 2.4 along it, as an
exponential's, and 0.84 at 0.2 and 0.28 at 0.44 in depth, as a Gaussian's."""
PLACE = 0.015
"""Half widths by which a table has a body aside of its place, a standard deviation: of 121 rows of
presses over random bodies places are then off by 0.8 of what is stated (rms), by 1.2 without."""
SMOOTH = 1.0
"""Half widths over which what is uneven in no known way is alike: with twice of it waves of 12 to
30 mm in the tissue's stiffness are lumps in 3 of 8 rows, with this in one, with 0.6 in one."""
ANY_MODULUS = 1.0
"""Standard deviation of the tissue's modulus, as a logarithm, where nothing else is asked of it."""
HEIGHTS = 3
"""Times that forces are made linear about the heights which follow from them."""
STEP = 1e-3
"""Of the depth, and half widths aside, to take slopes by."""
DRAWN, STARTS = 2000, 6
"""Points of the prior that are tried for each body, and the best ones that a fit starts from."""

MIN_DISTANCE = 1.6
"""Half widths between two bodies at least: 8 mm for a finger of 5 mm radius. Bumps add there: two
lumps at 8, 12 and 16 mm are off by 1.7, 0.5 and 0.1 % of the force, vessels by 0.04 % at most."""


@dataclass(frozen=True)
class Bodies:
    """The bodies of a row and the parameters of a point: the tissue's modulus, the pressures that
    all vessels have in common, and each body's own."""

    kinds: tuple[Kind, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """``log_modulus``, ``pressure``, ``0.depth``, ..."""
        beating = any(kind.beats for kind in self.kinds)
        own = [
            f"{n}.{name}" for n, kind in enumerate(self.kinds) for name in kind.parameters
            if name not in (*BLOCK, *OF_PRESSURES)
        ]  # fmt: skip
        return ("log_modulus", *(PRESSURES if beating else ()), *own)

    def column(self, n: int, name: str) -> int:
        """Where a parameter of the ``n``-th body is in a point."""
        return self.names.index(f"{n}.{name}")

    def places(self, theta: Array) -> Array:
        """Where each body lies (b, m), in half widths from the block's middle."""
        return theta[:, [self.column(n, "x") for n in range(len(self.kinds))]].T

    def of(self, theta: Array, n: int, block: Array) -> Array:
        """The ``n``-th body's parameters (m, p) in its units, and its ``block``'s (2,)."""
        columns = {name: theta[:, k] for k, name in enumerate(self.names)}
        if "pressure" in columns:
            pressure, swing = columns["pressure"], columns["swing"]
            columns[f"{n}.log_pressure"] = np.log(PA_PER_MMHG * pressure) - theta[:, 0]
            columns[f"{n}.swing"] = swing / pressure
        own = [columns[f"{n}.{name}"] for name in self.kinds[n].parameters[: -len(BLOCK)]]
        return np.hstack([np.stack(own, axis=1), np.tile(block, (len(theta), 1))])

    def ranges(self, row: Array, priors: Priors) -> Array:
        """Ends (2, p) of each parameter; bodies lie under the ``row`` (n,)."""
        softest_kpa, stiffest_kpa = priors.tissue_kpa
        ends = {
            "log_modulus": (np.log(1e3 * softest_kpa), np.log(1e3 * stiffest_kpa)),
            "pressure": priors.diastolic_mmhg, "swing": priors.pulse_pressure_mmhg,
        }  # fmt: skip
        for n, kind in enumerate(self.kinds):
            for name, low, high in zip(kind.parameters, kind.low, kind.high, strict=True):
                ends[f"{n}.{name}"] = (low, high)
            ends[f"{n}.x"] = (float(row.min()), float(row.max()))
        return np.array([ends[name] for name in self.names]).T


class Over(NamedTuple):
    """Right over a body, at a posterior's points (m,): the bare block's force [N], the ``bump``
    over that, the ``beat`` over the force, and what either may be off by at any point."""

    bare_n: Array
    bump: Array
    bump_sd: Array
    beat: Array
    beat_sd: Array


class Likelihood:
    """Of the data of one row over a known block, for any bodies in it.

    It compares logarithms of forces, and pulses over forces: what relaxes takes the same share of
    all of them. What nobody knows of surface, zero and relaxation enters as columns with a Gaussian
    prior each, which makes the noise correlated.
    """

    def __init__(
        self, data: RowData, table: TouchTable, scene: Scene, priors: Priors = DEFAULT
    ) -> None:
        assert scene.tissue is not None
        self.data, self.table, self.scene, self.priors = data, table, scene, priors
        self.half_width_m = 0.5e-3 * scene.indenter.width_mm_projected
        self.middle_m = 0.5e-3 * scene.tissue.width_mm
        self.x = (data.x_m - self.middle_m) / self.half_width_m
        self.sunk = data.sunk_m / self.half_width_m
        self.block = block_of(scene)
        self.area_m2 = self.half_width_m * 1e-3 * scene.indenter.length_mm
        self.bare = self._bare_n_per_pa(self.sunk)
        deeper = self._bare_n_per_pa(self.sunk * (1 + STEP))
        self.power = np.log(deeper / self.bare) / np.log(1 + STEP)
        self.at_depths: dict[str, AtDepths] = {
            kind.name: table.ratios[kind.name].at_depths(self.sunk, self.block) for kind in KINDS
        }
        self.measured = np.append(np.log(data.force_n).ravel(), data.pulse_n / data.force_n[:, -1])

    def _bare_n_per_pa(self, sunk: Array) -> Array:
        """The bare block's force over its modulus (n, d) at depths (d,)."""
        places, depths = np.meshgrid(self.x, sunk, indexing="ij")
        bare = self.table.bare_force(places.ravel(), depths.ravel(), self.block)
        return np.asarray(bare.reshape(places.shape) * self.area_m2)

    def predicted(self, bodies: Bodies, theta: Array) -> Array:
        """Logarithms of forces, and pulses over forces (m, n d + n), of ``theta`` (m, p)."""
        ratios = self.added(bodies, theta, self.x)
        total = np.maximum(1 + ratios[..., 0], 1e-3)
        log_force = theta[:, 0][:, None, None] + np.log(self.bare) + np.log(total)
        pulse = (ratios[..., 1] / total)[..., -1]
        return np.hstack([log_force.reshape(len(theta), -1), pulse])

    def ratios(self, bodies: Bodies, theta: Array, x: Array) -> list[Array]:
        """Bump and pulse (m, n, d, 2) of each body over the bare block's force, at places ``x``
        (n,), in half widths from the block's middle."""
        return [
            self.at_depths[kind.name](x, bodies.of(theta, n, self.block))
            for n, kind in enumerate(bodies.kinds)
        ]

    def added(self, bodies: Bodies, theta: Array, x: Array) -> Array:
        """The same of all bodies together: their bumps add (`MIN_DISTANCE`)."""
        nothing = np.zeros((len(theta), len(x), len(self.sunk), 2))
        return sum(self.ratios(bodies, theta, x), nothing)

    def over(self, bodies: Bodies, n: int, posterior: Posterior) -> Over:
        """Right over the ``n``-th body, as deep as a hold is, with what the row's own residuals say
        that the table is off by there."""
        points, count = posterior.points, len(self.x)
        kind, own = bodies.kinds[n], bodies.of(points, n, self.block)
        bump, pulse = self.at_depths[kind.name](own[:, :1], own)[:, 0, -1].T
        bare = np.exp(points[:, 0]) * np.interp(own[:, 0], self.x, self.bare[:, -1])
        error = self.table_error(bodies, posterior.best)
        covariance, shift = self._noise(bodies, posterior.best, error, 0.0)
        weight = np.linalg.solve(covariance, error)
        off = (self.measured - shift - self.predicted(bodies, points)) @ weight
        left = np.sqrt(np.maximum(np.diag(error - error @ weight), 0.0))
        place = np.interp(own[:, 0], self.x, np.arange(count))
        near = np.minimum(place.astype(int), count - 2)
        held = slice(len(self.sunk) - 1, self.bare.size, len(self.sunk))

        def there(at_stations: Array) -> Array:
            rows = np.broadcast_to(at_stations, (len(points), count))
            before, after = (
                np.take_along_axis(rows, k[:, None], 1)[:, 0] for k in (near, near + 1)
            )
            return np.asarray(before + (place - near) * (after - before))

        total = (1 + bump) * np.exp(there(off[:, held]))
        beats = pulse / (1 + bump) + there(off[:, self.bare.size :])
        return Over(
            bare, total - 1, there(left[held]) * total, beats, there(left[self.bare.size :])
        )

    def place_m(self, bodies: Bodies, n: int, posterior: Posterior) -> tuple[float, float, float]:
        """Of the ``n``-th body: the ends of its 95 % interval, and its median between them."""
        at_m = self.middle_m + self.half_width_m * bodies.places(posterior.points)[n]
        low_m, middle_m, high_m = posterior.quantiles(at_m)
        return float(low_m), float(middle_m), float(high_m)

    def model(
        self, bodies: Bodies, about: Array | None = None, error: Array | None = None,
        uneven: Array | float = 0.0,
    ) -> Model:  # fmt: skip
        """Made linear ``about`` some point (p,), with the covariance ``error`` of what the table is
        off by, `table_error` there by default.

        ``uneven``: covariance (n d, n d) of a share of the forces that varies along the row in no
        known way.
        """
        if error is None and about is not None:
            error = self.table_error(bodies, about)
        covariance, shift = self._noise(bodies, about, error, uneven)
        lower = np.linalg.cholesky(covariance)
        root, log_det = np.linalg.inv(lower), 2 * float(np.log(np.diag(lower)).sum())
        count = len(self.measured)
        low, high = bodies.ranges(self.x, self.priors)

        def misfit(theta: Array) -> Array:
            return (self.measured - shift - self.predicted(bodies, theta)) @ root.T

        def allowed(theta: Array) -> Bools:
            if not bodies.kinds:
                return np.ones(len(theta), dtype=bool)
            each = [kind.fits(bodies.of(theta, n, self.block))
                    for n, kind in enumerate(bodies.kinds)]  # fmt: skip
            far_enough = np.diff(bodies.places(theta), axis=0) >= MIN_DISTANCE
            return np.asarray(np.all(each, axis=0) & far_enough.all(axis=0))

        log_norm = -0.5 * (log_det + count * np.log(2 * np.pi))
        model = Model(low, high, misfit, allowed, log_norm, np.empty((0, len(low))))
        starts = self._starts(bodies, model) if about is None else about[None]
        return replace(model, starts=starts)

    def _starts(self, bodies: Bodies, model: Model) -> Array:
        """Of many points of the prior, each with the modulus that suits it, those of least misfit
        that have their bodies at different places."""
        rng = np.random.default_rng(0)
        points = rng.uniform(
            model.low, model.high, (DRAWN * max(len(bodies.kinds), 1), len(model.low))
        )
        at = [bodies.column(n, "x") for n in range(len(bodies.kinds))]
        points[:, at] = np.sort(points[:, at], axis=1)
        points = points[model.allowed(points)]
        if not len(points):
            return points
        forces = slice(0, self.bare.size)
        off = self.measured[forces] - self.predicted(bodies, points)[:, forces]
        points[:, 0] = np.clip(points[:, 0] + np.median(off, axis=1), model.low[0], model.high[0])
        chi2 = (model.misfit(points) ** 2).sum(axis=1)
        points, starts = points[np.argsort(chi2)], list[Array]()
        while len(points) and len(starts) < STARTS:
            starts.append(points[0])
            aside = np.abs(points[:, at] - points[0, at]).max(axis=1, initial=0.0)
            points = points[aside > MIN_DISTANCE / 2]
        return np.array(starts)

    def _noise(
        self, bodies: Bodies, about: Array | None, error: Array | None, uneven: Array | float
    ) -> tuple[Array, Array]:
        """Covariance of what is measured, and what heights of the surface add to it."""
        data, forces = self.data, slice(0, self.bare.size)
        force = data.force_n
        variance = np.append(
            (data.force_sd_n / force) ** 2 + MODEL**2,
            (data.pulse_sd_n**2 + (MODEL_OF_PULSE * data.pulse_n) ** 2) / force[:, -1] ** 2,
        )
        own = np.diag(variance)
        own[forces, forces] += uneven
        if error is not None:
            own += error
        shift, rest = np.zeros(len(own)), nuisance(data, self.priors, self.power)
        if about is not None:
            away = (self.measured - self.predicted(bodies, about[None])[0])[forces]
            for _ in range(HEIGHTS):
                of_forces = own[forces, forces] + rest.covariance
                heights_m = rest.of_heights @ np.linalg.solve(of_forces, away - rest.shift)
                rest = nuisance(data, self.priors, self.power, heights_m)
        shift[forces] = rest.shift
        own[forces, forces] += rest.covariance
        return own, shift

    def smooth(self) -> Array:
        """Correlation (n d, n d) of what is smooth along the row, and as smooth with each
        doubling of the depth."""
        along = np.exp(-0.5 * ((self.x[:, None] - self.x) / SMOOTH) ** 2)
        log_sunk = np.log(self.sunk)
        return np.asarray(np.kron(along, np.exp(-0.5 * (log_sunk[:, None] - log_sunk) ** 2)))

    def one_press(self, about: Array, error: Array, share: float) -> Array:
        """Log of how much likelier (n,) the row is over a bare block, about a point (1,), if each
        press alone is off by a ``share`` of its forces, a standard deviation: an update of rank one
        (Sherman and Morrison 1950). The modulus follows."""
        none = Bodies(())
        covariance, shift = self._noise(none, about, error, ANY_MODULUS**2)
        away = self.measured - shift - self.predicted(none, about[None])[0]
        count, depths = self.bare.shape
        alone = np.hstack([np.kron(np.eye(count), np.ones(depths)), np.zeros((count, count))])
        solved = np.linalg.solve(covariance, np.column_stack([away, alone.T]))
        variance = share**2 * (alone * solved[:, 1:].T).sum(axis=1)
        explained = (share * (alone @ solved[:, 0])) ** 2 / (1 + variance)
        return np.asarray(0.5 * (explained - np.log1p(variance)))

    def table_error(self, bodies: Bodies, about: Array) -> Array:
        """Covariance of what a table is off by about a point (p,): in each body's place, and alike
        over `REACH` and `REACH_SUNK`."""
        near = np.exp(-np.abs(self.x[:, None] - self.x) / REACH)
        near_sunk = np.exp(-0.5 * ((self.sunk[:, None] - self.sunk) / REACH_SUNK) ** 2)
        ratios = [ratio[0] for ratio in self.ratios(bodies, about[None], self.x)]
        total = 1 + sum(ratios, np.zeros((*self.bare.shape, 2)))[..., 0]
        ahead, behind = (self.ratios(bodies, about[None], self.x + by) for by in (STEP, -STEP))
        n, depths = self.bare.shape
        covariance = np.zeros((n * depths + n, n * depths + n))
        for k, (kind, ratio) in enumerate(zip(bodies.kinds, ratios, strict=True)):
            aside = PLACE * (ahead[k] - behind[k])[0] / (2 * STEP) / total[..., None]
            aside = np.append(aside[..., 0].ravel(), aside[:, -1, 1])
            covariance += np.outer(aside, aside)
            own = bodies.of(about[None], k, self.block)
            off = self.table.ratios[kind.name].off_by(self.x, own)
            bump = (np.hypot(off[:, :1], MODEL_OF_BUMP * ratio[..., 0]) / total).ravel()
            pulse = off[:, 1] / total[:, -1]
            levels, pulses = slice(0, n * depths), slice(n * depths, None)
            covariance[levels, levels] += np.outer(bump, bump) * np.kron(near, near_sunk)
            covariance[pulses, pulses] += np.outer(pulse, pulse) * near
        return covariance
