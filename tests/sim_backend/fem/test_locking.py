"""Inf-sup values, and hourglass patterns in a real press."""

import bodies
import numpy as np
import pytest
from scipy.linalg import eigh

from sim_backend.fem import internal
from sim_backend.fem.elements import HOURGLASS
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.scene.scene_file import load_scene


def inf_sup(element, n):
    """Smallest non-zero inf-sup value of the unit square, its outline fixed (Chapelle and Bathe
    1993, eq. 24): eigenvalues of B S^-1 B^T, S the H1 norm of displacements, B the volume change
    that each independent pressure sees.
    """
    body = bodies.body(bodies.grid(n, n, lambda p: p, wild=0.05), element)
    cells = body.section.cells
    size = body.section.size
    norm, swell = np.zeros((size, size)), []
    for dofs, b, w in zip(cells.dofs, cells.operator, cells.weight, strict=True):
        norm[np.ix_(dofs, dofs)] += np.einsum("q,qvd,qve->de", w, b, b)
        opening = w[:, None] * (b[:, 0] + b[:, 3])
        rows = opening.sum(axis=0, keepdims=True) if cells.dilatation else opening
        volumes = [w.sum()] if cells.dilatation else w
        for row, volume in zip(rows, volumes, strict=True):
            full = np.zeros(size)
            full[dofs] = row / np.sqrt(volume)
            swell.append(full)
    if cells.hourglass is not None:  # patterns that one point cannot see must cost something
        for dofs, gamma in zip(cells.dofs, cells.hourglass, strict=True):
            for axis in (0, 1):
                norm[np.ix_(dofs[axis::2], dofs[axis::2])] += np.outer(gamma, gamma)
    free = np.setdiff1d(np.arange(size), bodies.dofs(bodies.outline(body.section.mesh)))
    s, b = norm[np.ix_(free, free)], np.array(swell)[:, free]
    values = eigh(b @ np.linalg.solve(s, b.T), eigvals_only=True)
    assert values[0] > -1e-10
    return np.sqrt(values[values > 1e-8][0])


@pytest.mark.parametrize("element", ["T6M", "Q4M", "Q4R"])
def test_inf_sup_stays_away_from_zero(element):
    values = [inf_sup(element, n) for n in (2, 4, 8)]
    assert min(values) > 0.2
    assert values[2] > 0.85 * values[1]


def amplitudes_mm(plane):
    """Size of the hourglass patterns in Q4R under a finger."""
    scene = load_scene("TI").model_copy(update={"plane": plane})
    section, (solved,) = solve_finite(scene, 0.032, 2.0e-3, [0.0], 1e-3, "Q4R")
    gamma = section.cells.hourglass
    pattern = np.einsum("mk,mki->mi", gamma, solved.displacement[section.cells.nodes])
    return 1e3 * np.hypot(*pattern.T), solved.force_n_per_m


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_hourglass_patterns_are_held(plane, monkeypatch):
    """The force would not reveal them (0.1 %); what is left is the field's own bending."""
    pattern, force = amplitudes_mm(plane)
    assert np.median(pattern) < 3e-3
    monkeypatch.setattr(internal, "HOURGLASS", 5 * HOURGLASS)
    firmer, _ = amplitudes_mm(plane)
    assert np.median(firmer) > 0.8 * np.median(pattern)
    monkeypatch.setattr(internal, "HOURGLASS", 1e-3 * HOURGLASS)
    loose, loose_force = amplitudes_mm(plane)
    assert np.median(loose) > 3 * np.median(pattern)
    assert loose_force == pytest.approx(force, rel=0.003)
