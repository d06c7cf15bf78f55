"""The surface by touch: plane, quadric or free height map, robust against bad touches.

Heights are z in the scan frame [m] over x, y [m]. Plane and quadric are polynomials about the
touches' centre; the map is a smoothing thin-plate spline.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from math import comb
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from calibration.errors import CalibrationError
from calibration.fit import Array, Fit, Mask, as_columns, linear_fit

if TYPE_CHECKING:
    from scipy.interpolate import RBFInterpolator

Model = Literal["plane", "quadric", "map"]
TERMS = {"plane": 3, "quadric": 6, "map": 3}
ADVICE = "touch at more places, spread over the scanned area, not along one line"
SEARCH = 6000  # subsets tried for the cleanest core of the touches
STEEPEST = 1.73  # rise over run at 60 degrees; a scan refuses more than 30
OUTLIER_SIGMAS = 4.0  # robust standard deviations from which a touch is none of a height map
OUTLIER_CHANCE = 0.001  # chance that a good touch is called an outlier


@dataclass(frozen=True)
class SurfaceCalibration:
    """A height function; ``coefficients`` of 1, x, y, x^2, xy, y^2 about ``centre_m``.

    ``touches_m`` (n, 3) are those kept, ``rejected_m`` (m, 3) the outliers. ``smoothing``: of
    the height map's spline; without meaning otherwise. The residuals of ``fit`` are the touches'
    own, of a map those of the map through all the others.
    """

    KIND: ClassVar[str] = "surface"
    UNITS: ClassVar[dict[str, str]] = {
        "model": "",
        "centre_m": "m",
        "coefficients": "m, 1, 1/m",
        "touches_m": "m",
        "rejected_m": "m",
        "smoothing": "1",
    }
    model: Model
    centre_m: Array
    coefficients: Array
    touches_m: Array
    rejected_m: Array
    smoothing: float
    fit: Fit = field(repr=False)

    @cached_property
    def _map(self) -> "RBFInterpolator":
        return _sheet(self.touches_m, self.smoothing)

    def heights(self, x_m: Array, y_m: Array) -> Array:
        """Heights (n,) [m] at x (n,), y (n,) [m]."""
        xy = np.column_stack([np.ravel(x_m), np.ravel(y_m)]).astype(float)
        if self.model == "map":
            return np.asarray(self._map(xy))
        terms = _terms(xy - self.centre_m, len(self.coefficients))
        return np.asarray(terms @ self.coefficients)

    def misses(self, touches_m: Array) -> Array:
        """Heights of new touches (n, 3) less the expected ones (n,) [m]."""
        touches = np.asarray(touches_m)
        return np.asarray(touches[:, 2] - self.heights(touches[:, 0], touches[:, 1]))

    def height(self, x_m: float, y_m: float) -> float:
        """Height [m] at one place: the planner's ``Surface``."""
        return float(self.heights(np.array([x_m]), np.array([y_m]))[0])


def fit_surface(
    touches_m: Array,
    model: Model = "plane",
    *,
    max_outliers: int | None = None,
) -> SurfaceCalibration:
    """The surface through touches (n, 3) [m], the tip's lowest point at each.

    Up to ``max_outliers`` (a fifth of the touches) are found by least trimmed squares
    (Rousseeuw 1984): the cleanest core is fitted, then every touch that agrees with it at the
    0.1 % level is taken back. Raises `CalibrationError` for collinear or too few touches,
    or a rise of more than 60 degrees.
    """
    touches = as_columns(touches_m, "touches_m", 3)
    if model not in TERMS:
        raise CalibrationError(f"model = {model!r}: allowed are {', '.join(TERMS)}")
    if max_outliers is None:
        max_outliers = max(min(len(touches) // 5, len(touches) - TERMS[model] - 2), 0)
    centre = touches[:, :2].mean(axis=0)
    size = float(np.abs(touches[:, :2] - centre).max()) or 1.0
    count = TERMS[model]
    design = _terms((touches[:, :2] - centre) / size, count)
    names = ("height", "slope x", "slope y", "bend xx", "bend xy", "bend yy")[:count]
    linear_fit(design, touches[:, 2], names, ADVICE, weakest=0.03)  # refuses what is degenerate
    if model == "map":
        kept, smoothing = _good_for_map(touches, max_outliers)
    else:
        kept, smoothing = _core(design, touches[:, 2], max_outliers), 0.0
    fit = linear_fit(design[kept], touches[kept, 2], names, ADVICE, weakest=0.03)
    scale = np.diag(size ** -np.array([0.0, 1, 1, 2, 2, 2])[:count])
    fit = fit.derived(names, scale @ fit.values, scale)
    slopes = fit.values[1:3]
    if (steepest := float(np.hypot(*slopes))) > STEEPEST:
        raise CalibrationError(
            f"the surface rises by {steepest:.3g} m per metre; {STEEPEST:g} (60 degrees) are "
            "possible. Are heights in another unit than places?"
        )
    if model == "map":  # its coefficients are those of the plane through it, not what it leaves
        missed, _ = _left_out(touches[kept], smoothing)
        fit = replace(fit, residuals=-missed)
    return SurfaceCalibration(
        model, centre, fit.values, touches[kept], touches[~kept], smoothing, fit
    )


def _core(design: Array, z: Array, max_outliers: int) -> Mask:
    """True (n,) for touches that agree with the cleanest subset."""
    from scipy.special import stdtrit

    n, p = design.shape
    if max_outliers == 0:
        return np.ones(n, dtype=bool)
    if comb(n, max_outliers) <= SEARCH:
        choices = np.array(list(combinations(range(n), max_outliers)))
    else:
        rng = np.random.default_rng(0)
        choices = np.array([rng.permutation(n)[:max_outliers] for _ in range(SEARCH)])
    weight = np.ones((len(choices), n))
    np.put_along_axis(weight, choices, 0.0, axis=1)
    for _ in range(5):  # all subsets at once; concentration steps keep the best-fitting touches
        gram = np.einsum("cn,ni,nj->cij", weight, design, design)
        gram += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(p)
        moment = np.einsum("cn,ni,n->ci", weight, design, z)
        off = (z - np.linalg.solve(gram, moment[..., None])[..., 0] @ design.T) ** 2
        ranks = np.argsort(np.argsort(off, axis=1), axis=1)
        weight = (ranks < n - max_outliers).astype(float)
    kept = np.asarray(weight[np.argmin((weight * off).sum(axis=1))] > 0)
    while not kept.all():
        inverse = np.linalg.pinv(design[kept])
        residual = z - design @ (inverse @ z[kept])
        dof = int(kept.sum()) - p
        variance = float(residual[kept] @ residual[kept]) / max(dof, 1)
        leverage = ((design @ inverse) ** 2).sum(axis=1)
        score = np.abs(residual) / np.sqrt(max(variance, 1e-30) * (1 + leverage))
        score[kept] = np.inf
        nearest = int(np.argmin(score))
        if score[nearest] > stdtrit(max(dof, 1), 1 - OUTLIER_CHANCE / 2):
            break
        kept[nearest] = True
    return kept


def _good_for_map(points: Array, max_outliers: int) -> tuple[Mask, float]:
    """Touches kept and the smoothing that predicts left-out touches best.

    A touch is judged by how far the sheet through all others misses it, over how far it may: at
    the edges, where little holds the sheet, that is much (Rasmussen & Williams 2006, ch. 5.4.2).
    """
    kept = np.ones(len(points), dtype=bool)
    while True:
        trials = {s: _left_out(points[kept], s) for s in 10.0 ** np.arange(-8, 1)}
        smoothing = min(trials, key=lambda s: float(np.median(np.abs(trials[s][0]))))
        missed, share = trials[smoothing]
        score = np.abs(missed) / share
        worst = int(np.argmax(score))
        spread = 1.4826 * float(np.median(score))
        if (~kept).sum() >= max_outliers or score[worst] <= OUTLIER_SIGMAS * spread:
            return kept, smoothing
        kept[np.flatnonzero(kept)[worst]] = False


def _left_out(points: Array, smoothing: float) -> tuple[Array, Array]:
    """Error (n,) [m] at each touch of the sheet through all the others, and what standard
    deviation (n,) it may have, up to a common factor."""
    xy = points[:, :2]
    r2 = np.maximum(((xy[:, None] - xy) ** 2).sum(axis=-1), 1e-300)
    kernel = 0.5 * r2 * np.log(r2) + smoothing * np.eye(len(xy))
    free = np.linalg.qr(_terms(xy - xy.mean(axis=0), 3), mode="complete")[0][:, 3:]
    inverse = free @ np.linalg.solve(free.T @ kernel @ free, free.T)
    precision = np.maximum(np.diag(inverse), 1e-300)
    return -(inverse @ points[:, 2]) / precision, 1 / np.sqrt(precision)


def _sheet(points: Array, smoothing: float) -> "RBFInterpolator":
    from scipy.interpolate import RBFInterpolator

    return RBFInterpolator(
        points[:, :2], points[:, 2], kernel="thin_plate_spline", degree=1, smoothing=smoothing
    )


def _terms(xy: Array, count: int) -> Array:
    x, y = xy.T
    return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y][:count])
