"""Modulus and relaxation of a tissue from one indentation, by inverting a forward model.

The forward model is a callable, so that any solver (finite elements, Hertz) can be inverted:
``forward(moduli_pa (q,), depth_m (n,)) -> (force_n (n,), slopes (n, q))`` with the slopes
d force / d modulus of the model itself. Relaxation is quasi-linear (Fung 1993, ch. 7):

    F = F_e - sum g_i (F_e - H_i),   dH_i/dt = dF_e/dt - H_i / tau_i
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, as_columns, ascending, nonlinear_fit, same_length
from calibration.identify import limits_of

Forward = Callable[[Array, Array], tuple[Array, Array]]
ADVICE = "indent deeper, in a steady ramp of 20 samples or more, then hold"
FACTORS = (1.0, 0.3, 3.0)  # times which the guesses of relaxation times are tried
MOST_LOG_TAU = 50.0  # of tau in seconds: where nothing relaxes a fit may go on for ever
STEP_M = 1e-6  # of the depth derivative


@dataclass(frozen=True)
class TissueCalibration:
    """``modulus_pa`` (q,), ``surface_m`` (depth at which contact begins), Prony g and tau_s.

    ``adequate`` is False where the residuals follow a trend: the model is then wrong, whatever
    its intervals say. ``cannot_identify``: what these data leave open, in words.
    """

    KIND: ClassVar[str] = "tissue"
    UNITS: ClassVar[dict[str, str]] = {
        "modulus_pa": "Pa",
        "surface_m": "m",
        "relaxation_g": "1",
        "relaxation_tau_s": "s",
        "adequate": "",
        "cannot_identify": "",
    }
    modulus_pa: Array
    surface_m: float
    relaxation_g: Array
    relaxation_tau_s: Array
    adequate: bool
    cannot_identify: tuple[str, ...]
    fit: Fit = field(repr=False)

    def modulus_interval_pa(self, level: float = 0.95) -> Array:
        """Confidence intervals (q, 2) [Pa]; symmetric in the logarithm, which is what is fitted."""
        return np.asarray(np.exp(self.fit.interval(level)[: len(self.modulus_pa)]))


def fit_tissue(
    depth_m: Array,
    force_n: Array,
    forward: Forward,
    start_pa: Sequence[float],
    *,
    time_s: Array | None = None,
    relaxation_start_s: Sequence[float] = (),
    find_surface: bool = True,
    forward_off: float = 0.0,
) -> TissueCalibration:
    """The moduli that explain ``force_n`` (n,) [N] at ``depth_m`` (n,) [m, true indentation].

    ``relaxation_start_s``: one guess of tau for each Prony term wanted (needs ``time_s`` (n,)).
    ``find_surface``: the depth of first contact is a parameter too. Samples more than 4 robust
    standard deviations off are left out. ``forward_off``: the share by which all forces of
    ``forward`` may be off together (95 %), which the moduli's intervals hold. Raises
    `CalibrationError` on degenerate data.
    """
    depth, force = as_columns(depth_m, "depth_m", 1)[:, 0], as_columns(force_n, "force_n", 1)[:, 0]
    same_length(depth_m=depth, force_n=force)
    terms, moduli = len(relaxation_start_s), len(start_pa)
    if terms and time_s is None:
        raise CalibrationError("relaxation needs time_s; record when each sample was taken")
    time = np.arange(len(depth), dtype=float)
    if time_s is not None:
        time = as_columns(time_s, "time_s", 1)[:, 0]
        same_length(depth_m=depth, time_s=time)
        ascending("time_s", time)
    if min(start_pa) <= 0 or (terms and min(relaxation_start_s) <= 0):
        raise CalibrationError("start values of moduli and relaxation times must be positive")
    if len(depth) < 10 or np.ptp(depth) < 0.05 * max(float(depth.max()), 1e-9) or depth.max() <= 0:
        raise CalibrationError(f"the depth hardly varies; {ADVICE}")
    model = _Model(depth, time, forward, moduli, find_surface, terms)
    elastic, _ = forward(np.array(start_pa, dtype=float), depth)
    rises = (force - force.mean()) @ (elastic - elastic.mean()) > 0
    if not (elastic @ elastic > 0 and force @ elastic > 0 and rises):
        raise CalibrationError("the force does not rise with depth; check its sign and the tare")
    scale = float(force @ elastic) / float(elastic @ elastic)
    start = np.concatenate(
        [
            np.log(np.array(start_pa) * scale),
            np.zeros(int(find_surface)),
            np.full(terms, 0.3 / max(terms, 1)),
            np.log(np.array(relaxation_start_s, dtype=float)),
        ]
    )
    names = tuple(
        [f"log modulus {n}" if moduli > 1 else "log modulus" for n in range(moduli)]
        + ["surface"] * find_surface
        + [f"g {n}" for n in range(terms)]
        + [f"log tau {n}" for n in range(terms)]
    )
    size = float(np.abs(force).max())
    fit = _best(
        lambda p: (model.force(p) - force) / size,
        lambda p: model.slopes(p) / size,
        [start + np.append(np.zeros(len(start) - terms), np.full(terms, np.log(factor)))
         for factor in (FACTORS if terms else (1.0,))],
        names,
    )  # fmt: skip
    p, first = fit.values, moduli + int(find_surface)
    tau = np.exp(np.clip(p[first + terms :], -MOST_LOG_TAU, MOST_LOG_TAU))
    covariance = fit.covariance.copy()
    covariance[:moduli, :moduli] += (forward_off / 2) ** 2
    spacing, length = float(np.median(np.diff(time))), float(np.ptp(time))
    adequate, limits = limits_of(fit, tau, spacing, length)
    return TissueCalibration(
        modulus_pa=np.exp(p[:moduli]),
        surface_m=1e-3 * float(p[moduli]) if find_surface else 0.0,
        relaxation_g=p[first : first + terms],
        relaxation_tau_s=tau,
        adequate=adequate,
        cannot_identify=limits,
        fit=Fit(fit.names, fit.values, covariance, size * fit.residuals, fit.dof),
    )


def _best(
    misfit: Callable[[Array], Array],
    slopes: Callable[[Array], Array],
    starts: Sequence[Array],
    names: Sequence[str],
) -> Fit:
    """The best fit of several starts: relaxation has more than one minimum."""
    fits, reasons = [], []
    for start in starts:
        try:
            fits.append(
                nonlinear_fit(
                    misfit, start, names, f"{ADVICE}, or fit fewer parameters", jacobian=slopes,
                    robust=True,
                )
            )  # fmt: skip
        except CalibrationError as error:
            reasons.append(error)
    if not fits:
        raise reasons[0]
    return min(fits, key=lambda one: one.noise)


class _Model:
    """Force and its derivatives for log moduli, surface [mm], g and log tau."""

    def __init__(
        self, depth: Array, time: Array, forward: Forward, moduli: int, surface: bool, terms: int
    ) -> None:
        self.depth, self.time, self.forward = depth, time, forward
        self.moduli, self.surface, self.terms = moduli, surface, terms
        self.step = float(np.median(np.diff(time)))
        self.grid = np.arange(time[0], time[-1] + self.step, self.step)

    def force(self, p: Array) -> Array:
        elastic, _ = self._elastic(p)
        return self._relax(p, elastic)

    def slopes(self, p: Array) -> Array:
        elastic, by_modulus = self._elastic(p)
        moduli = np.exp(p[: self.moduli])
        columns = [
            self._relax(p, column * e) for column, e in zip(by_modulus.T, moduli, strict=True)
        ]
        if self.surface:
            ahead, behind = (
                self.forward(moduli, self.depth - 1e-3 * p[self.moduli] + h)[0]
                for h in (STEP_M, -STEP_M)
            )
            columns.append(self._relax(p, -1e-3 * (ahead - behind) / (2 * STEP_M)))
        g, log_tau = self._prony(p)
        memories = [self._memory(elastic, np.exp(one)) for one in log_tau]
        columns += [memory - elastic for memory in memories]
        h = 1e-4
        columns += [
            weight
            * (self._memory(elastic, np.exp(one + h)) - self._memory(elastic, np.exp(one - h)))
            / (2 * h)
            for weight, one in zip(g, log_tau, strict=True)
        ]
        return np.column_stack(columns)

    def _elastic(self, p: Array) -> tuple[Array, Array]:
        depth = self.depth - 1e-3 * p[self.moduli] if self.surface else self.depth
        return self.forward(np.exp(p[: self.moduli]), depth)

    def _prony(self, p: Array) -> tuple[Array, Array]:
        first = self.moduli + int(self.surface)
        log_tau = np.clip(p[first + self.terms :], -MOST_LOG_TAU, MOST_LOG_TAU)
        return p[first : first + self.terms], log_tau

    def _relax(self, p: Array, elastic: Array) -> Array:
        force = elastic
        for g, log_tau in zip(*self._prony(p), strict=True):
            force = force - g * (elastic - self._memory(elastic, np.exp(log_tau)))
        return force

    def _memory(self, elastic: Array, tau_s: float) -> Array:
        """H (n,): the elastic force with exponentially fading memory, exact between samples."""
        from scipy.signal import lfilter

        even = np.interp(self.grid, self.time, elastic)
        decay = np.exp(-self.step / tau_s)
        gain = tau_s / self.step * (1 - decay)
        memory = lfilter([gain], [1.0, -decay], np.diff(even, prepend=0.0))
        return np.interp(self.time, self.grid, memory)
