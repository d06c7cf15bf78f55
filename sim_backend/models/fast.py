"""The fast model: one scene's force and stress over place, depth and pressure, by its stations.

Each place that is solved is a `sim_backend.models.station_response`, which knows all depths and
pressures. Between places force and stress follow cubics through the four nearest. In the middle of
two places one more is solved; where the cubic was off there, so is one in each half. What cubics
were off by in the last middles is part of the stated error: it falls by a factor of 4 or more.
"""

from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array, Ints
from sim_backend.models.ahead import SolvedAhead
from sim_backend.models.press_range import LEAST_SHARE
from sim_backend.models.response import Range, StationResponse, levels_pa
from sim_backend.models.station_response import station
from sim_backend.scene.scene_file import Scene, SceneError

OFF_SHARE = np.array([0.5, 1.0])
"""What a cubic may be off by of force and pulse, over what stations state of them: no place
more mends what is their meshes'."""
SMALL_PULSE = 0.01
"""A pulse below this share of the force is judged against the share."""
SHALLOWEST = 0.2
"""Least depth that is known, over the greatest: the first that a solid's stations solve."""
NEAR_SHARE = 0.5
"""Depth over the greatest at which a cubic is judged too: bumps of shallow presses are narrower."""
FIRST_STEP = 2.0
"""Most between two places before any is put between them, over the finger's half width."""
SIDE_M, SIDE_SHARE = 4e-3, 1 / 8
"""The outermost places lie so far from a side, or this share of a narrow block's width."""
LEAST_STEP = 1 / 16
"""Least between two places, over the finger's half width: meshes that change jump by a little."""
MOST_PLACES = 200
"""Places that are solved; what is left where they end is stated."""
NEAREST = 4


@dataclass(frozen=True)
class FastModel:
    """The answers of `StationResponse`, between its ``stations`` at places ``x_m`` (n,), n > 3.
    ``off`` are the shares of force and pulse that the cubics were off by."""

    x_m: Array
    stations: tuple[StationResponse, ...]
    off: tuple[float, float]

    @property
    def range(self) -> Range:
        """From the first place to the last, and what all stations know."""
        here = self.stations[0].range
        depths = (SHALLOWEST * here.depth_m[1], here.depth_m[1])
        return Range((float(self.x_m[0]), float(self.x_m[-1])), depths, here.pressure_pa)

    def force_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Normal force [N] on the whole finger."""
        return self._sum("force_n", x_m, depth_m, pressure_pa)

    def von_mises_pa(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Von Mises stress [Pa] at the surface under the finger."""
        return self._sum("von_mises_pa", x_m, depth_m, pressure_pa)

    def error_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """What the force may be off by [N]."""
        at = x_m, depth_m, pressure_pa
        return np.asarray(self._sum("error_n", *at) + self.off[0] * self.force_n(*at))

    def pulse_error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike
    ) -> Array:
        """What the change of force between two pressures may be off by [N]."""
        stations = self._sum("pulse_error_n", x_m, depth_m, low_pa, high_pa)
        low, high = (self.force_n(x_m, depth_m, p) for p in (low_pa, high_pa))
        pulse = np.maximum(np.abs(high - low), SMALL_PULSE * np.maximum(low, high))
        return np.asarray(stations + np.where(low == high, 0.0, self.off[1] * pulse))

    def _sum(self, of: str, x_m: ArrayLike, depth_m: ArrayLike, *pressures: ArrayLike) -> Array:
        """What a method of stations answers, summed over the nearest ones."""
        for pressure_pa in pressures:
            self.range.check(x_m, depth_m, pressure_pa)
        x, *load = np.broadcast_arrays(x_m, depth_m, *pressures)
        shape, x, load = x.shape, x.ravel(), [one.ravel() for one in load]
        near, weight = _cubic(self.x_m, x)
        total = np.zeros(len(x))
        for number in np.unique(near):
            at, which = np.nonzero(near == number)
            here = self.stations[number]
            total[at] += weight[at, which] * getattr(here, of)(here.x_m, *(a[at] for a in load))
        return total.reshape(shape)


def fast_model(scene: Scene, max_depth_mm: float = 2.5) -> FastModel:
    """The fast model of a block, down to ``max_depth_mm``: seconds for a section, minutes for a
    solid, whose stations are kept on disk; above z = 0.

    Raises `SceneError` for a depth that cannot be meant or a lone vessel, and `CannotSolve` where
    a place meets a physical limit.
    """
    if scene.tissue is None:
        raise SceneError(
            f"{scene.name} is a lone vessel, which is pressed over its middle only: the fast model "
            "needs [tissue]; take --model finite"
        )
    least_mm = LEAST_SHARE * scene.indenter.width_mm_projected
    if not least_mm < max_depth_mm < scene.surface_mm:
        raise SceneError(
            f"max_depth_mm = {max_depth_mm:g}: must lie between {least_mm:g} and "
            f"the {scene.surface_mm:g} mm of {scene.name}"
        )
    return _solved(scene, round(1e-3 * max_depth_mm, 9))


@lru_cache(maxsize=8)
def _solved(scene: Scene, max_depth_m: float) -> FastModel:
    known: dict[float, StationResponse] = {}

    def with_places(more: list[float]) -> FastModel:
        with closing(SolvedAhead(station(scene, x, max_depth_m) for x in more)) as respond:
            known.update((x, respond(scene, x, max_depth_m)) for x in more)
        x_m = sorted(known)
        return FastModel(np.array(x_m), tuple(known[x] for x in x_m), (0.0, 0.0))

    model = with_places(places := first_places(scene))
    left, least_m = model.stations[0].left, LEAST_STEP * scene.indenter.profile.scale
    enough, worst, ends = OFF_SHARE * [left.rest, left.change], np.zeros(2), list(pairwise(places))
    while ends:
        middles = [round((a + b) / 2, 9) for a, b in ends]
        finer = with_places(middles)
        off = np.array([_off(scene, model, finer, x) for x in middles])
        again = (off > enough).any(axis=1) & (np.diff(ends, axis=1)[:, 0] > 2 * least_m)
        again &= len(known) + 2 * int(again.sum()) <= MOST_PLACES
        worst = np.max([worst, *off[~again]], axis=0)
        ends = [half for x, more in zip(middles, again, strict=True) if more
                for half in _halves(finer.x_m, x)]  # fmt: skip
        model = finer
    return replace(model, off=(float(worst[0]), float(worst[1])))


def _halves(x_m: Array, middle: float) -> list[tuple[float, float]]:
    """To both neighbours of a place."""
    k = int(np.searchsorted(x_m, middle))
    return [(float(x_m[k - 1]), float(x_m[k])), (float(x_m[k]), float(x_m[k + 1]))]


def first_places(scene: Scene) -> list[float]:
    """Places [m] before any is put between them: evenly, and over each inclusion."""
    assert scene.tissue is not None
    width_m = 1e-3 * scene.tissue.width_mm
    side_m = min(SIDE_M, SIDE_SHARE * width_m)
    over = {round(1e-3 * one.x_mm, 9) for one in scene.inclusion}
    stops = sorted({side_m, *(x for x in over if side_m < x < width_m - side_m), width_m - side_m})
    step_m = FIRST_STEP * scene.indenter.profile.scale
    places = {stops[0]}
    for a, b in pairwise(stops):
        count = max(NEAREST - 1 if len(stops) == 2 else 2, int(np.ceil((b - a) / step_m)))
        places |= {round(float(x), 9) for x in np.linspace(a, b, count + 1)[1:]}
    return sorted(places)


def _off(scene: Scene, coarse: FastModel, fine: FastModel, x_m: float) -> tuple[float, float]:
    """Shares of force and pulse that cubics were off by at a place."""
    _, *ends = levels_pa(scene) if scene.arteries else (0.0, 0.0, 0.0)
    depths = coarse.range.depth_m[1] * np.array([NEAR_SHARE, 1.0])
    at = x_m, depths[:, None], np.array(ends)
    ours, truth = coarse.force_n(*at), fine.force_n(*at)
    pulse = np.abs(np.diff(truth, axis=1))
    pulse = np.maximum(pulse, SMALL_PULSE * truth.max(axis=1, keepdims=True))
    wrong = np.abs(np.diff(ours, axis=1) - np.diff(truth, axis=1))
    return float(np.abs(ours / truth - 1).max()), float((wrong / pulse).max())


def _cubic(nodes: Array, at: Array) -> tuple[Ints, Array]:
    """Numbers and weights (n, 4) of the ``nodes`` that a cubic goes through at ``at`` (n,)."""
    first = np.clip(np.searchsorted(nodes, at) - NEAREST // 2, 0, len(nodes) - NEAREST)
    near = first[:, None] + np.arange(NEAREST)
    x, weight = nodes[near], np.ones(near.shape)
    for i in range(NEAREST):
        for j in range(NEAREST):
            if i != j:
                weight[:, i] *= (at - x[:, j]) / (x[:, i] - x[:, j])
    return near, weight
