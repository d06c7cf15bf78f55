"""Steps of Newton's method: which of them form a tangent, and how exact what they end at is."""

import numpy as np
import pytest

from sim_backend.fem import newton
from sim_backend.fem.assembly import Assembly
from sim_backend.fem.continuation import continuation, unloaded
from sim_backend.fem.model import Section, build_section
from sim_backend.fem.newton import Load, Solution
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


def test_the_last_step_takes_the_tangent_that_is_there(
    section: Section, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each equilibrium's last iteration only looks; of the steps before, some form no tangent."""
    formed = []
    factor = Assembly.factor

    def counted(self: Assembly, matrices: list[np.ndarray]) -> object:
        formed.append(1)
        return factor(self, matrices)

    monkeypatch.setattr(Assembly, "factor", counted)
    steps = sum(one.iterations - 1 for one in solved(section))
    assert steps - len(WAY) <= len(formed) < steps - 1


def test_that_costs_no_exactness(section: Section, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against residuals a hundred times smaller, which tangents formed anew lead to."""
    usual = solved(section)
    monkeypatch.setattr(newton, "TOLERANCE", 1e-2 * newton.TOLERANCE)
    exact = solved(section)
    forces, wanted = (np.array([one.force_n_per_m for one in each]) for each in (usual, exact))
    np.testing.assert_allclose(forces, wanted, rtol=1e-6)
    assert np.diff(forces)[-1] == pytest.approx(np.diff(wanted)[-1], rel=1e-5)
    for one, other in zip(usual, exact, strict=True):
        largest = np.abs(other.displacement).max()
        np.testing.assert_allclose(one.displacement, other.displacement, atol=1e-5 * largest)
