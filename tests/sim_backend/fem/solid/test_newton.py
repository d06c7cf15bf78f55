"""Newton's method in solids: its way, not only its end."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_solid import small_solid

from sim_backend.fem import continuation as following
from sim_backend.fem.body import Tangent
from sim_backend.fem.continuation import continuation
from sim_backend.fem.descent import share_of_step
from sim_backend.fem.newton import Load, NotConverged, equilibrium, is_stable, unloaded
from sim_backend.fem.solid.body import ON_THE_WAY, TOLERANCE
from sim_backend.fem.solid.build import build_body
from sim_backend.fem.solid.forces import tangents
from sim_backend.fem.solid.linear import LinearSolver
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.scene.scene_file import Scene

SCENE = small_solid(24.0, 20.0, height_mm=12.0, poisson=0.49, ball_mm=5.0)


def test_a_deep_first_touch_takes_few_steps() -> None:
    """Springs of the first gap are forty times the contact force: they must turn no normals."""
    body = build_body(SCENE, 12e-3, depth_m=1e-3, size_m=1.6e-3)
    found = equilibrium(body, unloaded(body), Load(0.35e-3, 0.0))
    assert found.iterations <= 6


def test_a_finer_mesh_begins_where_the_coarser_one_ended() -> None:
    coarse = solve_solid(SCENE, 12e-3, 0.6e-3, [0.0], 2.5e-3)
    _, (anew,) = solve_solid(SCENE, 12e-3, 0.6e-3, [0.0], 2.0e-3)
    _, (carried,) = solve_solid(SCENE, 12e-3, 0.6e-3, [0.0], 2.0e-3, coarser=coarse)
    assert carried.force_n == pytest.approx(anew.force_n, rel=1e-5)
    assert carried.iterations <= 6
    assert carried.stable is True


def test_an_indefinite_tangent_is_left_by_shorter_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the shortest may go on with it: they alone may end in an unstable state."""
    body = build_body(SCENE, 12e-3, depth_m=1e-3, size_m=2.5e-3)
    steps: list[int] = []
    solve = LinearSolver.solve
    monkeypatch.setattr(LinearSolver, "solve", lambda *given: (steps.append(1), solve(*given))[1])
    for negative, borne in ((1, 4), (2, 2), (4, 1)):
        monkeypatch.setattr(LinearSolver, "negative", property(lambda _, n=negative: n))
        steps.clear()
        with pytest.raises(NotConverged, match="stayed indefinite"):
            equilibrium(body, unloaded(body), Load(0.5e-3, 0.0))
        assert len(steps) == borne
    allowed, slacks = [], []

    def indefinite(_b: Any, start: Any, load: Load, *, slack: float, careful: bool) -> Any:
        allowed.append((load.depth_m, careful))
        slacks.append(slack)
        if not careful:
            raise NotConverged("the tangent stayed indefinite")
        return replace(start, load=load)

    monkeypatch.setattr(following, "equilibrium", indefinite)
    (found,) = continuation(body, unloaded(body), [Load(0.8e-3, 0.0)])
    assert found.load.depth_m == pytest.approx(0.8e-3)
    whole = [(pytest.approx(0.8e-3 / 2**k), False) for k in range(3)]
    assert allowed[:4] == [*whole, (pytest.approx(0.1e-3), True)]
    there = [depth_m == pytest.approx(0.8e-3) for depth_m, _ in allowed]
    assert slacks == [1.0 if end else ON_THE_WAY for end in there]
    slacks.clear()
    way = [Load(1e-5, 0.0)]
    list(continuation(body, unloaded(body), [Load(2e-5, 0.0)], way))
    assert ON_THE_WAY in slacks[:1]


def test_a_node_slides_over_an_edge_finer_than_the_elements() -> None:
    """The body of revolution, whose elements are finer than the edge, tells 0.705 N at 1.2 mm and
    0.820 at 1.4. Rounding decides at which of the depths plain steps leap to and fro."""
    punch = {"shape": "flat", "diameter_mm": 8.0, "edge_radius_mm": 0.3}
    scene = Scene.model_validate(SCENE.model_dump() | {"indenter": punch})
    body = build_body(scene, 12e-3, depth_m=0.3e-3, size_m=2e-3)
    way = [Load(depth_m, 0.0) for depth_m in (0.35e-3, 0.7e-3, 1.05e-3)]
    *_, before = continuation(body, unloaded(body), way)

    def fails(depth_mm: float) -> bool:
        try:
            equilibrium(body, before, Load(1e-3 * depth_mm, 0.0))
        except NotConverged:
            return True
        return False

    depth_mm = next(filter(fails, (1.2, 1.25, 1.3, 1.35, 1.4)))
    (found,) = continuation(body, before, [Load(1e-3 * depth_mm, 0.0)])
    stated_n = np.interp(depth_mm, [1.2, 1.4], [0.705, 0.82])
    assert found.force_n == pytest.approx(stated_n, rel=0.025)
    assert is_stable(body, found)


@pytest.mark.parametrize("too_far", [1 / 8, 1.0, 5.0])
def test_a_step_ends_where_energy_falls_no_more(too_far: float) -> None:
    body = build_body(SCENE, 12e-3, depth_m=1e-3, size_m=2.5e-3)
    load = Load(0.35e-3, 0.0)
    found = equilibrium(body, unloaded(body), load)
    off = np.zeros_like(found.displacement)
    off[:, 1] = 1e-5 * np.sin(np.pi * body.wedges.nodes[:, 1] / 12e-3)  # no move of the bottom
    start = found.displacement - off
    share = share_of_step(body, load.depth_m, 0.0, start, too_far * off, found.multiplier, ())
    assert 0.5 <= share * too_far <= 1.5


def test_a_load_that_is_only_passed_is_solved_roughly_and_changes_no_answer() -> None:
    body = build_body(SCENE, 12e-3, depth_m=1e-3, size_m=2.5e-3)
    down = [Load(1e-3 * d, 0.0) for d in (0.3, 0.65, 1.0)]
    *on_the_way, there = continuation(body, unloaded(body), down)
    passed = []
    now = unloaded(body)
    for load in down[:2]:
        now = equilibrium(body, now, load, slack=ON_THE_WAY)
        passed.append(now)
    spared = sum(a.iterations - b.iterations for a, b in zip(on_the_way, passed, strict=True))
    assert spared > 0
    off = [b.force_n / a.force_n - 1 for a, b in zip(on_the_way, passed, strict=True)]
    assert 1e-8 < np.abs(off).max() < 0.02
    (found,) = continuation(body, unloaded(body), down[2:], down[:2])
    assert found.force_n == pytest.approx(there.force_n, rel=2 * TOLERANCE)  # of either


def test_factors_say_whether_the_tangent_is_indefinite() -> None:
    body = build_body(SCENE, 12e-3, depth_m=1e-3, size_m=2.5e-3)
    down = np.tile([0.0, 1.0, 0.0], len(body.wedges.nodes))
    for sign in (1.0, -1.0):
        solver = replace(body).linear
        still = unloaded(body).displacement
        blocks = sign * tangents(body.wedges, body.shear, body.bulk, still)
        nothing = [np.zeros((n, 3, 3)) for n in (len(body.surface), 0)]
        solver.linearise(Tangent([blocks], nothing, nothing))
        solver.step(down, 0.0)
        assert (solver.negative > 0) is (sign < 0)
