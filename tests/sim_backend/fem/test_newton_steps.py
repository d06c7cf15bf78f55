"""Steps of Newton's method: which of them form a tangent, and how exact what they end at is."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sim_backend import Scene
from sim_backend.fem import continuation as continuation_module
from sim_backend.fem import newton
from sim_backend.fem import section as section_rules
from sim_backend.fem.assembly import Assembly
from sim_backend.fem.continuation import continuation
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import build_section
from sim_backend.fem.newton import Load, Solution, unloaded
from sim_backend.fem.section import Section
from sim_backend.scene.waves import PA_PER_MMHG
from tests.support.small_block import BLOCK

PRESSURE_PA = 90 * PA_PER_MMHG
WAY = [Load(-1e-3, PRESSURE_PA), Load(0.2e-3, PRESSURE_PA), Load(0.5e-3, PRESSURE_PA),
       Load(1e-3, PRESSURE_PA), Load(1e-3, 120 * PA_PER_MMHG)]  # fmt: skip


@pytest.fixture(params=["stress", "strain"])
def section(request: pytest.FixtureRequest) -> Section:
    scene = BLOCK.model_copy(update={"plane": request.param})
    return build_section(scene, 11e-3, depth_m=1e-3, size_m=0.5e-3)


def solved(section: Section) -> list[Solution]:
    return list(continuation(section, unloaded(section), WAY))


def test_the_last_steps_take_the_tangent_that_is_there(
    section: Section, monkeypatch: pytest.MonkeyPatch
) -> None:
    formed = []
    factor = Assembly.factor

    def counted(self: Assembly, matrices: list[np.ndarray]) -> object:
        formed.append(1)
        return factor(self, matrices)

    monkeypatch.setattr(Assembly, "factor", counted)
    steps = sum(one.iterations - 1 for one in solved(section))
    assert steps - section_rules.CHORDS * len(WAY) <= len(formed) < steps - len(WAY)


def test_that_costs_no_exactness(section: Section, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = solved(section)
    monkeypatch.setattr(section_rules, "TOLERANCE", 1e-2 * section_rules.TOLERANCE)
    exact = solved(replace(section))
    forces, wanted = (np.array([one.force_n_per_m for one in each]) for each in (usual, exact))
    np.testing.assert_allclose(forces, wanted, rtol=1e-6)
    assert np.diff(forces)[-1] == pytest.approx(np.diff(wanted)[-1], rel=1e-5)
    for one, other in zip(usual, exact, strict=True):
        largest = np.abs(other.displacement).max()
        np.testing.assert_allclose(one.displacement, other.displacement, atol=1e-5 * largest)


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_the_way_down_belongs_to_the_finger(plane: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(times: float) -> tuple[list[int], float]:
        taken.clear()
        _, (found,) = solve_finite(
            enlarged(times), times * 12e-3, times * 1.5e-3, [PRESSURE_PA], times * 1e-3
        )
        return list(taken), found.force_n_per_m

    def enlarged(times: float) -> Scene:
        table = BLOCK.model_dump() | {"plane": plane}
        for part in (table["tissue"], *table["inclusion"], table["indenter"]):
            for key, value in part.items():
                if key.endswith("_mm") and value is not None:
                    part[key] = times * value
        return Scene.model_validate(table)

    taken: list[int] = []
    equilibrium = newton.equilibrium

    def counted(section: Section, start: Solution, load: Load, **rules: Any) -> Solution:
        found = equilibrium(section, start, load, **rules)
        taken.append(found.iterations)
        return found

    monkeypatch.setattr(continuation_module, "equilibrium", counted)
    steps, force = pressed(1.0)
    larger, larger_force = pressed(2.0)
    assert len(larger) == len(steps)
    assert larger_force == pytest.approx(2 * force, rel=2e-3)  # on a mesh of its own
    monkeypatch.setattr(section_rules, "STEP", 0.1)
    monkeypatch.setattr(section_rules, "GENTLE_STEP", 0.08)
    more, other_force = pressed(1.0)
    assert len(more) > len(steps)
    assert other_force == pytest.approx(force, rel=1e-5)
