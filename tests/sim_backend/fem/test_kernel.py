"""The compiled kernel says what numpy says, to rounding; and a press can be solved without it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

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


def refuses(function: Callable[..., Any], right: list[Any], *wrong: tuple[int, Any]) -> None:
    """``right`` is taken, and none with one of ``wrong`` (which argument, what instead) is."""
    function(*right)
    for place, array in wrong:
        with pytest.raises((ValueError, IndexError, BufferError)):
            function(*right[:place], array, *right[place + 1 :])


@pytest.mark.skipif(not kernel.BUILT, reason="the kernel was not built")
def test_arrays_that_do_not_fit_a_section_are_refused(section: Section) -> None:
    cells, u = section.cells, np.zeros_like(section.mesh.nodes)
    solid = [u, cells.nodes, cells.gradient, cells.weight, section.shear, section.bulk, 0]
    refuses(
        kernel.least_area_ratio, solid, (0, u[:-1]), (1, cells.nodes.astype(np.int32)),
        (2, cells.gradient[:-1]), (3, cells.weight[:-1]), (4, section.shear[:-1]),
        (5, section.bulk[::2]),
    )  # fmt: skip
    built = [section.size, (cells.dofs,), (True,), section.assembly.free]
    refuses(kernel.Fronts, built, (0, section.size - 1))
    fronts = kernel.Fronts(*built)
    with pytest.raises(ValueError, match="want"):
        fronts.factor((np.zeros((len(cells.dofs), 2, 2)),))
    with pytest.raises(ValueError, match="want"):
        fronts.solve(np.zeros(section.size), np.zeros(section.size - 1))


@pytest.mark.skipif(not kernel.BUILT, reason="the kernel was not built")
def test_arrays_that_do_not_fit_a_solid_are_refused() -> None:
    def zeros(*shape: int) -> Array:
        return np.zeros(shape, np.float32)

    def ones(*shape: int) -> Array:
        return np.ones(shape, np.float32)

    blocks, place = zeros(2, 12, 12), np.zeros((2, 4, 4), np.int64)
    refuses(kernel.join_blocks, [blocks, place, zeros(5, 3, 3)], (0, blocks[:1]), (1, place + 5),
            (1, place - 1), (0, blocks.astype(float)), (1, place[:, :3]))  # fmt: skip
    columns, starts = np.array([0, 1, 1]), np.array([0, 2, 3])
    product = [ones(3, 3, 3), columns, starts, ones(6), ones(6)]
    refuses(kernel.block_product, product, (0, ones(2, 3, 3)), (1, columns + 1), (2, starts + 1),
            (2, starts - 1), (3, ones(5)), (4, ones(5)))  # fmt: skip
    at = np.array([0, 1])
    front = [zeros(6, 6), at, zeros(6, 3), zeros(3, 3)]
    refuses(kernel.extend_front, front, (0, zeros(3, 6)), (1, at[::-1].copy()), (1, at + 1),
            (2, zeros(4, 1)), (3, zeros(2, 2)))  # fmt: skip
    border = np.array([2, 3, 4])
    for substitute in (kernel.front_down, kernel.front_up):
        given = [ones(2, 2), zeros(3, 2), border, ones(2), ones(5)]
        refuses(substitute, given, (0, ones(1, 2)), (1, zeros(2, 2)), (2, border + 1),
                (3, ones(1)), (4, np.ones(5)))  # fmt: skip
    f = np.zeros((1, 2, 3, 3))
    wedge = [np.zeros((1, 2, 18, 3)), f, f, np.zeros((1, 2, 4)), zeros(1, 54, 54)]
    refuses(kernel.wedge_tangents, wedge, (0, np.zeros((1, 1, 18, 3))), (1, f[:, :1]),
            (2, f[..., :2].copy()), (3, np.zeros((1, 2, 3))),
            (4, np.zeros((1, 54, 54))))  # fmt: skip
