"""The compiled kernel says what numpy says, to rounding; and a press can be solved without it."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend import load_scene
from sim_backend.arrays import Array
from sim_backend.fem import kernel
from sim_backend.fem.elements import ELEMENTS
from sim_backend.fem.internal import internal_forces, least_area_ratio
from sim_backend.fem.lumen import unit_pressure
from sim_backend.fem.model import build_section
from sim_backend.fem.newton import Solution
from sim_backend.fem.section import Section
from sim_backend.models.press import press
from tests.support.small_block import BLOCK

ROUNDING = 1e-12
"""Of the largest entry; both sum some twenty products."""


@pytest.fixture(scope="module", params=ELEMENTS)
def section(request: pytest.FixtureRequest) -> Section:
    return build_section(BLOCK, 11e-3, depth_m=1e-3, size_m=0.8e-3, element=request.param)


def stirred(section: Section, seed: int, share: float = 0.1) -> Array:
    """Displacements (n, 2) that strain every cell by about ``share``, each in its own way."""
    smallest = np.sqrt(section.cells.weight.min())
    shape = (len(section.mesh.nodes), 2)
    uneven = np.random.default_rng(seed).uniform(-1, 1, shape) * smallest
    x, y = section.mesh.nodes.T
    return share * (np.column_stack([y - 0.4 * x, 0.3 * x + 0.5 * y]) + uneven)


def found(section: Section, seed: int) -> list[Array]:
    u, change = stirred(section, seed), stirred(section, seed + 100, 0.01)
    force, tangents = internal_forces(section, u, change)
    pressed = [one for sides in section.lumens for one in unit_pressure(sides, u)]
    return [force, tangents(), *pressed, np.array([least_area_ratio(section, u)])]


@pytest.mark.skipif(not kernel.BUILT, reason="the kernel was not built")
@pytest.mark.parametrize("plane_stress", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_cells_and_lumens_of_random_states(
    section: Section, plane_stress: bool, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    lumens = tuple(replace(sides, free=plane_stress) for sides in section.lumens)
    body = replace(section, plane_stress=plane_stress, lumens=lumens)
    compiled = found(body, seed)
    monkeypatch.setattr(kernel, "BUILT", False)
    for ours, wanted in zip(compiled, found(body, seed), strict=True):
        assert np.isfinite(wanted).all()
        np.testing.assert_allclose(ours, wanted, rtol=0, atol=ROUNDING * np.abs(wanted).max())


@pytest.mark.skipif(not kernel.BUILT, reason="the kernel was not built")
@pytest.mark.parametrize("name", ["TIHA", "SAOT"])
@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_a_whole_press(name: str, plane: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same steps of Newton's method, to the same forces, stress and stability."""
    scene = load_scene(name).model_copy(update={"plane": plane})

    def pressed() -> tuple[list[int], Array]:
        found = press(scene, 32.4, 1.5, accuracy_pct=5, model="finite")
        solved = [one.solution for one in found.states if isinstance(one.solution, Solution)]
        answers = [(one.force_n, one.von_mises_pa, one.stable) for one in found.states]
        return [one.iterations for one in solved], np.array(answers)

    steps, answers = pressed()
    monkeypatch.setattr(kernel, "BUILT", False)
    plain_steps, wanted = pressed()
    assert len(steps) == 2
    assert steps == plain_steps
    np.testing.assert_allclose(answers, wanted, rtol=1e-9)


@pytest.mark.skipif(not kernel.BUILT, reason="the kernel was not built")
def test_arrays_that_do_not_fit_are_refused(section: Section) -> None:
    """A wrong size or a node that is not there is an error, and reads no foreign memory."""
    cells, u = section.cells, np.zeros_like(section.mesh.nodes)
    solid = [u, cells.nodes, cells.gradient, cells.weight, section.shear, section.bulk, 0]
    assert kernel.least_area_ratio(*solid) == 1.0
    wrong = {0: u[:-1], 1: cells.nodes.astype(np.int32), 2: cells.gradient[:-1],
             3: cells.weight[:-1], 4: section.shear[:-1], 5: section.bulk[::2]}  # fmt: skip
    for place, array in wrong.items():
        given = [*solid[:place], array, *solid[place + 1 :]]
        with pytest.raises((ValueError, IndexError, BufferError)):
            kernel.least_area_ratio(*given)
    fronts = kernel.Fronts(section.size, (cells.dofs,), (True,), section.assembly.free)
    with pytest.raises(ValueError, match="want"):
        fronts.factor((np.zeros((len(cells.dofs), 2, 2)),))
    with pytest.raises(ValueError, match="want"):
        fronts.solve(np.zeros(section.size), np.zeros(section.size - 1))
    with pytest.raises(IndexError):
        kernel.Fronts(section.size - 1, (cells.dofs,), (True,), section.assembly.free)
    place, sums = np.zeros((2, 4, 4), dtype=np.int64), np.zeros((5, 3, 3), dtype=np.float32)
    blocks = np.zeros((2, 12, 12), dtype=np.float32)
    for given in ((blocks[:1], place, sums), (blocks, place + 5, sums), (blocks, place - 1, sums),
                  (blocks.astype(float), place, sums), (blocks, place[:, :3], sums)):  # fmt: skip
        with pytest.raises((ValueError, IndexError, BufferError)):
            kernel.join_blocks(*given)
    blocks, columns, starts = (
        np.ones((3, 3, 3), np.float32),
        np.array([0, 1, 1]),
        np.array([0, 2, 3]),
    )
    x, y = np.ones(6, np.float32), np.ones(6, np.float32)
    kernel.block_product(blocks, columns, starts, x, y)
    for given in ((blocks[:2], columns, starts, x, y), (blocks, columns + 1, starts, x, y),
                  (blocks, columns, starts + 1, x, y), (blocks, columns, starts - 1, x, y),
                  (blocks, columns, starts, x[:5], y),
                  (blocks, columns, starts, x, y[:5])):  # fmt: skip
        with pytest.raises((ValueError, IndexError)):
            kernel.block_product(*given)
    update, at = np.zeros((6, 6), dtype=np.float32), np.array([0, 1])
    top, rest = np.zeros((6, 3), dtype=np.float32), np.zeros((3, 3), dtype=np.float32)
    kernel.extend_front(update, at, top, rest)
    for given in ((update[:3], at, top, rest), (update, at[::-1].copy(), top, rest),
                  (update, at + 1, top, rest), (update, at, top[:4, :1].copy(), rest),
                  (update, at, top, rest[:2, :2].copy())):  # fmt: skip
        with pytest.raises((ValueError, IndexError)):
            kernel.extend_front(*given)
    root, own, x = np.ones((2, 2), np.float32), np.ones(2, np.float32), np.ones(5, np.float32)
    coupled, border = np.zeros((3, 2), np.float32), np.array([2, 3, 4])
    for substitute in (kernel.front_down, kernel.front_up):
        substitute(root, coupled, border, own, x)
        for given in ((root[:1], coupled, border, own, x), (root, coupled[:2], border, own, x),
                      (root, coupled, border + 1, own, x), (root, coupled, border, own[:1], x),
                      (root, coupled, border, own, x.astype(float))):  # fmt: skip
            with pytest.raises((ValueError, IndexError)):
                substitute(*given)
    gradient, f, slopes = np.zeros((1, 2, 18, 3)), np.zeros((1, 2, 3, 3)), np.zeros((1, 2, 4))
    tangent = np.zeros((1, 54, 54), np.float32)
    kernel.wedge_tangents(gradient, f, f, slopes, tangent)
    for given in ((gradient[:, :1], f, f, slopes, tangent),
                  (gradient, f[:, :1], f, slopes, tangent),
                  (gradient, f, f[..., :2].copy(), slopes, tangent),
                  (gradient, f, f, slopes[..., :3].copy(), tangent),
                  (gradient, f, f, slopes, tangent.astype(float))):  # fmt: skip
        with pytest.raises(ValueError):
            kernel.wedge_tangents(*given)
