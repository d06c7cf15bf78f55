"""The phantom: where the tip is, the lumen's pressure, and the force on the tip.

The simulated stage moves in it and the simulated sensor feels it, so place, time and force agree.
The answer for any time is computed from the trajectory, never stepped: reading in small or large
pieces gives the same numbers.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from drivers import Clock
from sim_backend.arrays import Array, Bools
from sim_backend.models.ahead import SolvedAhead
from sim_backend.models.station_response import station
from sim_backend.phantom.trajectory import Leg, Point, Rest, Trajectory
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.slicing import section_at
from sim_backend.scene.taxels import TaxelArray
from sim_backend.scene.waves import load_wave

Surface = Callable[[float, float], float]

PRESSED_M = 0.25e-3  # resting shallower than this is a touch, not an indentation: no beat starts
RELAXATION_STEP_S = 1e-3
DRAG_GRID_M = 1e-3  # sideways under the surface, the sections of whole millimetres stand in
INCLINED_GRID_M = 0.5e-3  # going in along an inclined normal, those of half millimetres
STEEP = 0.6  # sideways share of a press's direction, at most
PLACE_GRID_M = 1e-5
DEPTH_GRID_M = 1e-8
DEEPER = 1.25  # a choice between solving often and solving deeper than is pressed
BISECTIONS = 60  # of a depth: far below what changes even a rigid block's force
SLOPE_M = 0.1e-3  # the surface's slope is taken this far to either side
BULGE_M = 0.7e-3  # a filled vessel lifts the surface by up to this: there the section is asked


class Response(Protocol):
    """What is asked of a section's force model at one place; arguments broadcast, 0 in the air."""

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array: ...
    def von_mises_pa(self, depth_m: Array, pressure_pa: Array) -> Array: ...


class TaxelResponse(Response, Protocol):
    """That of a place whose taxels are known: their shares (n, rows, columns) of the force."""

    def shares(self, depth_m: Array, pressure_pa: Array) -> Array: ...


Respond = Callable[..., Response]
"""Of a scene, x [m], the greatest depth [m], and ``array=`` a `TaxelArray` where there is one: then
it gives a `TaxelResponse`."""
Quantity = Callable[[Response], Callable[..., Array]]


class Phantom:
    """A scene with a tip over it.

    The rig frame is the scene's: x along the surface, y along the vessel (the scene's z), z up,
    0 at the surface unless ``surface`` (height in m over x, y in m) says otherwise. ``respond``
    gives the elastic answer of a section; ``depth_m`` is the depth it is first asked for.
    ``seed`` sets the phase of a free-running pulse; ``folder`` is where a wave file lies.
    ``stiffness_n_m`` of the rig that carries the tip: it gives way to the elastic force.
    """

    def __init__(
        self,
        scene: Scene,
        clock: Clock,
        respond: Respond,
        *,
        seed: int = 0,
        surface: Surface = lambda _x, _y: 0.0,
        home: Point = (0.0, 0.0, 5e-3),
        depth_m: float = 2.5e-3,
        folder: Path | None = None,
    ) -> None:
        self.scene = scene
        self.clock = clock
        self.surface = surface
        self.tip = Trajectory(home, clock.now())
        self.stiffness_n_m = math.inf
        self._respond = respond
        self._depth_m = depth_m
        self._wave = load_wave(scene.pulse, folder)
        self._lead_s = np.random.default_rng(seed).uniform(0, self._wave.period_s)
        self._responses: dict[tuple[float, float], tuple[float, Response]] = {}
        self._ahead: SolvedAhead | None = None
        self.array: TaxelArray | None = None
        if scene.tissue is not None and scene.tissue.relaxation:
            import_module("scipy.linalg")  # now: later a reading would wait for it

    def force_n(self, time_s: Array) -> Array:
        """Normal force (n,) [N] on the whole indenter at ascending ``time_s`` (n,)."""
        force: Array = self._answer(time_s, lambda r: r.force_n)[0]
        return force

    def force_at(self, time_s: float) -> float:
        """Normal force [N] at one time."""
        return float(self.force_n(np.array([time_s]))[0])

    def force_and_stress(self, time_s: Array) -> Array:
        """Force as `force_n`, and von Mises stress [Pa] at the surface under the finger, the
        paper's criterion: (2, n)."""
        return self._answer(time_s, lambda r: r.force_n, lambda r: r.von_mises_pa)

    def feel_with(self, array: TaxelArray) -> None:
        """Have the finger carry an array. Raises `SceneError` if it carries another, or if its
        taxels are too fine for a solid's elements."""
        if self.array not in (None, array):
            raise SceneError(f"taxels: a finger carries one array; this has {self.array}")
        from sim_backend.models.bodies import body_of  # here: it loads the finite elements

        body_of(self.scene).need_taxels(self.scene, array)
        if self.array is None:
            self._responses.clear()  # what was solved before knows no taxels
        self.array = array

    def taxels_n(self, time_s: Array) -> Array:
        """Force (n, rows, columns) [N] on each taxel at ascending ``time_s`` (n,): its share of
        `force_n`, so that relaxation takes the same part from all."""
        assert self.array is not None
        force, pressure = self.force_n(time_s), self.pressure_pa(time_s)
        taxels = np.zeros((len(time_s), self.array.rows, self.array.columns))
        for leg, _, span in self.tip.legs(time_s):
            points = leg.points(time_s[span])
            depth = self._depth(points, leg.point(math.inf))
            for here, section, sunk in self._touched(leg, points, depth, pressure[span]):
                taxels[span][here] = section.shares(sunk, pressure[span][here])
        return taxels * force[:, None, None]

    def depth_m(self, time_s: Array) -> Array:
        """Indentation (n,) [m] at ascending ``time_s`` (n,), negative in the air."""
        depth = np.empty(len(time_s))
        for leg, _, span in self.tip.legs(time_s):
            depth[span] = self._depth(leg.points(time_s[span]), leg.point(math.inf))
        return depth

    def pressure_pa(self, time_s: Array) -> Array:
        """Pressure (n,) [Pa] in the lumen at ascending ``time_s`` (n,).

        With ``pulse.start = "hold"`` the beat begins whenever the tip comes to rest under the
        surface and runs on until it rests in the air; before, the lumen rests at the wave's
        first value.
        """
        if self.scene.pulse.start == "free":
            return self._wave.pressure_pa(time_s + self._lead_s)
        since = np.zeros(len(time_s))
        for leg, before, span in self.tip.legs(time_s):
            t = time_s[span]
            now = Rest(leg.end_s, leg.point(math.inf))
            if self._pressed(before):
                since[span] = t - before.time_s
            since[span] = np.where(
                t >= now.time_s, (t - now.time_s) if self._pressed(now) else 0.0, since[span]
            )
        return self._wave.pressure_pa(since)

    def prepare(self, places: list[tuple[float, float]]) -> None:
        """Solve the sections at ``places`` (x, y) [m] now, so that no reading waits for them."""
        for x, y in places:
            self._response(_snap(x, PLACE_GRID_M), _snap(y, PLACE_GRID_M), self._depth_m)

    def solve_ahead(self, places: list[tuple[float, float]]) -> None:
        """Let other processes begin with the sections at ``places`` (x, y) [m], in the order in
        which they will be pressed straight down; `close` ends them. They are answered by
        `sim_backend.models.station_response`."""
        depth_m = _up_to_grid(self._depth_m)
        snapped = [self.place_of((x, y, 0.0)) for x, y in places]
        self._ahead = SolvedAhead(
            station(section_at(self.scene, 1e3 * y), x, depth_m, self.array) for x, y in snapped
        )
        self._respond = self._ahead

    def close(self) -> None:
        """End what solves ahead."""
        if self._ahead is not None:
            self._ahead.close()

    def place_of(self, point: Point) -> tuple[float, float]:
        """The place (x, y) [m] whose section answers a press straight down at ``point``."""
        return _snap(point[0], PLACE_GRID_M), _snap(point[1], PLACE_GRID_M)

    def depth_to_solve_m(self, point: Point) -> float:
        """Down to where a section is solved for a press to ``point`` [m]."""
        depth_m = max(self._depth_m, self.surface(*point[:2]) - point[2])
        return _up_to_grid(depth_m)

    def depth_ahead_m(self, place: tuple[float, float], depth_m: float) -> float:
        """How deep to solve a place that is pressed to ``depth_m`` [m]: where it is known less
        deep, the press comes bit by bit and goes on."""
        further = DEEPER if place in self._responses else 1.0
        return _up_to_grid(max(self._depth_m, further * depth_m))

    def in_air(self, point: Point) -> bool:
        """Whether the tip touches nothing there, however far a vessel lifts the surface."""
        return self.surface(*point[:2]) - point[2] <= -BULGE_M

    def solved_m(self, place: tuple[float, float]) -> float:
        """Down to where the section at a place is solved [m]; 0 if it is not."""
        return self._responses.get(place, (0.0, None))[0]

    def learn(self, place: tuple[float, float], depth_m: float, response: Response) -> None:
        """Take the answer of a section that somebody else has solved."""
        self._responses[place] = (depth_m, response)

    def _answer(self, time_s: Array, *quantities: Quantity) -> Array:
        """Each quantity (quantities, n) at ascending ``time_s`` (n,)."""
        values = np.zeros((len(quantities), len(time_s)))
        pressure = self.pressure_pa(time_s)
        for leg, before, span in self.tip.legs(time_s):
            t = time_s[span]
            points = leg.points(t)
            depth = self._depth(points, leg.point(math.inf))
            if (depth <= -BULGE_M).all():
                continue
            elastic = self._elastic(leg, points, depth, pressure[span], quantities)
            if self.scene.tissue is not None and self.scene.tissue.relaxation:
                elastic -= self._relaxed_away(t, before, quantities)
            values[:, span] = np.maximum(elastic, 0.0)
        return values

    def _elastic(
        self,
        leg: Leg,
        points: Array,
        depth: Array,
        pressure: Array,
        quantities: Sequence[Quantity],
    ) -> Array:
        """The answers without relaxation."""
        values = np.zeros((len(quantities), len(points)))
        for here, section, sunk in self._touched(leg, points, depth, pressure):
            for answer, quantity in zip(values, quantities, strict=True):
                answer[here] = quantity(section)(sunk, pressure[here])
        return values

    def _touched(
        self, leg: Leg, points: Array, depth: Array, pressure: Array
    ) -> Iterator[tuple[Bools, Any, Array]]:
        """Of each place in contact which points (n,) are over it, its own section, and how deep the
        tip is there."""
        sideways = math.hypot(*leg.direction[:2])
        grid = INCLINED_GRID_M if sideways < STEEP else DRAG_GRID_M
        if sideways < 1e-6:  # no more than rounding
            grid = PLACE_GRID_M
        places = np.round(points[:, :2] / grid)
        touching = depth > -BULGE_M
        for x, y in _distinct(places[touching]):
            here = touching & (places[:, 0] == x) & (places[:, 1] == y)
            section = self._response(float(x * grid), float(y * grid), float(depth[here].max()))
            yield here, section, self._sunk(section, depth[here], pressure[here])

    def _sunk(self, section: Response, depth: Array, pressure: Array) -> Array:
        """True depth (n,): what is left when the rig has given way, d + F(d) / k = ``depth``."""
        if math.isinf(self.stiffness_n_m):
            return depth
        low = depth - section.force_n(depth, pressure) / self.stiffness_n_m
        high = depth
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            over = middle + section.force_n(middle, pressure) / self.stiffness_n_m > depth
            low, high = np.where(over, low, middle), np.where(over, middle, high)
        return np.asarray((low + high) / 2)

    def _relaxed_away(self, time_s: Array, before: Rest, quantities: Sequence[Quantity]) -> Array:
        """What relaxation took off (quantities, n), by quasi-linear viscoelasticity.

        F = F_e - sum g_i (F_e - H_i), dH_i/dt = dF_e/dt - H_i/tau_i, with F_e the elastic answer
        to the indentation at the resting pressure (Fung 1993, ch. 7; H by the exact step for a
        piecewise linear F_e). The pulse is not relaxed: softening everything alike does not
        change the load that a given pressure passes on.
        """
        from scipy.linalg import solve_banded

        assert self.scene.tissue is not None
        start = math.floor(self._in_air_since(before) / RELAXATION_STEP_S)
        stop = math.ceil(time_s[-1] / RELAXATION_STEP_S) + 1
        grid = np.arange(start, stop + 1) * RELAXATION_STEP_S
        elastic = np.zeros((len(quantities), len(grid)))
        resting = np.full(len(grid), self._wave.pressure_pa(np.zeros(1))[0])
        for leg, _, span in self.tip.legs(grid):
            points = leg.points(grid[span])
            depth = self._depth(points, leg.point(math.inf))
            elastic[:, span] = self._elastic(leg, points, depth, resting[span], quantities)
        rise = np.diff(elastic, prepend=elastic[:, :1])
        taken = np.zeros(elastic.shape)
        for g, tau_s in self.scene.tissue.relaxation:
            decay = math.exp(-RELAXATION_STEP_S / tau_s)
            gain = tau_s / RELAXATION_STEP_S * (1 - decay)
            bands = np.broadcast_to([[1.0], [-decay]], (2, len(grid)))
            taken += g * (elastic - solve_banded((1, 0), bands, gain * rise.T).T)
        return np.array([np.interp(time_s, grid, one) for one in taken])

    def _in_air_since(self, before: Rest) -> float:
        """The last time known to be out of contact: where the relaxation's memory starts."""
        while self._depth(np.array([before.point]), before.point)[0] > 0:
            earlier = self.tip.rest_before(before.time_s)
            if earlier.time_s >= before.time_s:
                break
            before = earlier
        return before.time_s

    def _depth(self, points: Array, end: Point) -> Array:
        """Of points on a leg, along the normal at the leg's ``end``: there it presses."""
        places = _distinct(points[:, :2])
        if len(places) == 1:
            height = np.float64(self.surface(*places[0].tolist()))
            depth = np.asarray(height - points[:, 2])
        else:
            heights = [self.surface(x, y) for x, y in points[:, :2].tolist()]
            depth = np.asarray(np.array(heights) - points[:, 2])
        if (depth <= -BULGE_M).all():
            return depth
        return np.asarray(depth / math.hypot(1.0, *slope_at(self.surface, end)))

    def _pressed(self, rest: Rest) -> bool:
        x, y, z = rest.point
        return self.surface(x, y) - z > PRESSED_M

    def _response(self, x: float, y: float, depth_m: float) -> Response:
        known_m, response = self._responses.get((x, y), (0.0, None))
        if response is None or _up_to_grid(depth_m) > known_m:
            known_m = self.depth_ahead_m((x, y), depth_m)
            more = {} if self.array is None else {"array": self.array}
            response = self._respond(section_at(self.scene, 1e3 * y), x, known_m, **more)
            self._responses[x, y] = (known_m, response)
        return response


def _snap(value: float, grid: float) -> float:
    return float(np.round(value / grid) * grid)


def _up_to_grid(depth_m: float) -> float:
    return math.ceil(depth_m / DEPTH_GRID_M - 1e-3) * DEPTH_GRID_M  # never rounded down


def _distinct(rows: Array) -> Array:
    """Those rows of (n, 2) that differ; a press straight down has one, which needs no sorting."""
    if (rows == rows[:1]).all():
        return rows[:1]
    return np.unique(rows, axis=0)


def slope_at(surface: Surface, place: Point) -> tuple[float, float]:
    """How far a ``surface`` of heights [m] rises [m/m] along x and y under a place."""
    x, y, _ = place
    along_x = surface(x + SLOPE_M, y) - surface(x - SLOPE_M, y)
    along_y = surface(x, y + SLOPE_M) - surface(x, y - SLOPE_M)
    return along_x / (2 * SLOPE_M), along_y / (2 * SLOPE_M)
