"""A solid's answer at one place, for any depth and lumen pressure, kept on disk.

One ramp is solved at the resting pressure; at some of its depths systole is solved too, and at the
full one diastole. Between depths force and stress follow powers of the depth that change
evenly with its logarithm (a ball's first is 3/2: Hertz; Johnson 1985, eq. 4.22). The mesh is the
first of those that `sim_backend.models.solid_press` refines.

Where nothing but the block's ends varies along z, a place beside the middle is solved as two blocks
that are symmetric about it, each half modelled: with ends a and b away the force is
    F(a, b) = F + e(a) + e(b) = [F(a, a) + F(b, b)] / 2
but for what the ends do to each other's effect, of the order of (e(a) - e(b))^2 / F.
"""

from math import ceil
from pathlib import Path

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.continuation import continuation, judged, stable_branch
from sim_backend.fem.finite_strain import down, filled
from sim_backend.fem.newton import CannotSolve, Load, Solution, Unstable
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.build import build_body, half_width_m
from sim_backend.fem.solid.solve import STEP
from sim_backend.fem.solid.stress import under_finger_pa
from sim_backend.models.curve import from_nothing, monotone
from sim_backend.models.kept_tables import kept_table, table_file
from sim_backend.models.response import Curve, Left, StationResponse, levels_pa
from sim_backend.models.solid_press import SHARES
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.scene_file import Scene

DEPTHS = np.array([0.2, 0.4, 0.6, 0.8, 1.0])
"""Shares of the greatest depth that are solved. The first is 0.5 mm of the usual 2.5: a contact
that is narrower than two elements is resolved too roughly."""
FILLED = np.array([0, 2, 4])
"""Those of them at which systole is solved too."""
LEFT = Left(rest=0.05, change=0.05, between=0.01, faint=0.0015)
"""TIHA under a ball: from this mesh to the next the force changes by 1.7 %, which leaves 3.8 % at
the rate of `refine.ORDER`, and the pulse by 0.1 %, which one scene cannot promise to others;
between depths 0.2 % of the deepest. 20 mm beside TIHA's vessel under the cylinder the pulse is
0.9 mN of 8.3 off at 0.87 N, 0.11 % of the force."""
WAY = 5
"""Number of the way of solving; what was kept by another way is solved again."""
SOLVED = ("ramp", "filled", "lowest", "bulge")
"""The arrays of `solve_place`."""


def respond_solid(scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
    """The answer of a solid ``scene`` above (``x_m``, z = 0) [m] down to ``max_depth_m`` [m].

    Raises `CannotSolve` where physics ends, and `SceneError` where elements cannot be made.
    """
    tables = [_table(part, x_m, max_depth_m) for part in symmetric_parts(scene)]
    table = {key: np.mean([one[key] for one in tables], axis=0) for key in tables[0]}
    rest, low, high = levels_pa(scene) if scene.arteries else (0.0, 0.0, 0.0)
    sunk = max_depth_m * DEPTHS + float(table["bulge"])

    def curve(which: int) -> Curve:
        at_rest, at_high = table["ramp"][:, which], table["filled"][:, which]
        lowest = float(table["lowest"][which])
        slope = (at_high - at_rest[FILLED]) / max(high - rest, 1.0)
        shares = _bend(low - rest, high - rest, lowest - at_rest[-1], slope[-1])
        return Curve(
            from_nothing(sunk, at_rest, _slopes(sunk, at_rest)),
            tuple(
                monotone(np.append(0.0, sunk[FILLED]), np.append(0.0, share * slope))
                for share in shares
            ),
            rest, low, high,
        )  # fmt: skip

    return StationResponse(x_m, max_depth_m, 1.0, float(table["bulge"]), curve(0), curve(1), LEFT)


def _table(scene: Scene, x_m: float, max_depth_m: float) -> dict[str, Array]:
    path = _file(scene, x_m, max_depth_m)
    return kept_table(path, SOLVED, lambda: solve_place(scene, x_m, max_depth_m))


def is_kept(scene: Scene, x_m: float, max_depth_m: float) -> bool:
    """Whether the answer lies on disk."""
    return all(_file(part, x_m, max_depth_m).exists() for part in symmetric_parts(scene))


def symmetric_parts(scene: Scene) -> list[Scene]:
    """The blocks whose mean is the answer: two for a straight scene beside its middle, up to where
    an end comes under the finger; else the scene itself."""
    tissue = scene.tissue
    assert tissue is not None and tissue.length_mm is not None  # the scene was checked
    aside_mm = abs(tissue.z_mm or 0.0)
    near_mm = tissue.length_mm / 2 - aside_mm
    under = near_mm < scene.indenter.breadth_mm_projected / 2
    if not is_straight(scene) or aside_mm == 0.0 or under:
        return [scene]
    return [
        scene.model_copy(update={"tissue": tissue.model_copy(
            update={"length_mm": round(2 * end_mm, 9), "z_mm": None})})
        for end_mm in (near_mm, near_mm + 2 * aside_mm)
    ]  # fmt: skip


def is_straight(scene: Scene) -> bool:
    """Whether nothing but the block's ends varies along z."""
    return all(
        isinstance(one, Artery)
        and not one.path
        and (one.stenosis is None or one.stenosis.z_mm is None)
        for one in scene.inclusion
    )


def _file(scene: Scene, x_m: float, max_depth_m: float) -> Path:
    content = [scene.model_dump(mode="json", exclude={"name"}), x_m, max_depth_m, WAY]
    return table_file("solid", content)


def solve_place(scene: Scene, x_m: float, max_depth_m: float) -> dict[str, Array]:
    """Force [N] and stress [Pa]: ``ramp`` (d, 2) at rest over `DEPTHS`, ``filled`` (f, 2) at
    systole over those `FILLED`, ``lowest`` (2,) at the full depth and diastole; ``bulge`` [m].

    Raises `CannotSolve`.
    """
    rest, low, high = levels_pa(scene) if scene.arteries else (0.0, 0.0, 0.0)
    between = max(1, ceil(max_depth_m * DEPTHS[0] / (STEP * half_width_m(scene))))
    depths = np.linspace(0.0, max_depth_m, len(DEPTHS) * between + 1)[1:]
    body = body_for(scene, x_m, max_depth_m)
    start, bulge = filled(body, rest, max_depth_m)
    solved = list(down(body, start, [Load(float(d), rest) for d in depths]))
    ramp = solved[between - 1 :: between]
    if judged(body, ramp[-1]).stable is False:
        stable = _fallen(body, ramp[-1])
        if stable is None or abs(stable.force_n / ramp[-1].force_n - 1) > LEFT.rest:
            raise CannotSolve(
                "stability",
                f"{1e3 * max_depth_m:g} mm deep at x = {1e3 * x_m:g} mm the solid is unstable: it "
                "would give way sideways. Press less deep.",
            )
        ramp[-1] = stable

    def at(one: Solution, pressure_pa: float) -> tuple[float, float]:
        if scene.arteries:
            (one,) = continuation(body, one, [Load(one.load.depth_m, pressure_pa)])
        return one.force_n, under_finger_pa(body, one.displacement)

    lowest = at(ramp[-1], low)
    at_systole = [at(ramp[k], high) for k in FILLED[::-1]][::-1]
    return {
        "ramp": np.array([(one.force_n, under_finger_pa(body, one.displacement)) for one in ramp]),
        "filled": np.array(at_systole), "lowest": np.array(lowest), "bulge": np.array(bulge),
    }  # fmt: skip


def _fallen(body: SolidBody, unstable: Solution) -> Solution | None:
    try:
        return stable_branch(body, unstable)
    except Unstable:
        return None


def body_for(scene: Scene, x_m: float, max_depth_m: float) -> SolidBody:
    """The mesh that a solid's stations and their pictures are solved on."""
    size_m = SHARES[0] * half_width_m(scene)
    return build_body(scene, x_m, depth_m=max_depth_m, size_m=size_m)


def _slopes(x: Array, y: Array) -> Array:
    """Of ``y`` (n,) at ``x`` (n,), n > 2: the exponent of the power of x between two of them, and
    at them a parabola's through three."""
    exponent = np.gradient(np.log(np.maximum(y, 1e-12)), np.log(x), edge_order=2)
    return np.asarray(np.maximum(exponent, 0.0) * y / x)


def _bend(low: float, high: float, at_low: float, slope: float) -> Array:
    """Coefficients of g(p), p over rest [Pa], of the first power on: g(high) = high, slope g(low) =
    at_low."""
    if high <= 0 or low >= 0 or slope == 0:
        return np.ones(1)
    bend = (at_low / (slope * low) - 1) / (low - high)
    return np.array([1 - bend * high, bend])
