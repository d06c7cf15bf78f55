"""Meshes refined until force and pulse converge, and the error that remains."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.newton import CannotSolve, Solution
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray

ORDER = 1.6
"""The error of a mesh in tissue falls at least as this power of the size."""
SMALL_PULSE = 1e-3
"""A pulse below this share of the force is judged against the share: no sensor feels it."""
WORTHLESS_PCT = 50.0
"""A force that meshes disagree on by more is no answer."""

Solving = Callable[[str], None]
"""Receives a line about what is to be solved next."""


@dataclass(frozen=True)
class Asked:
    """A press ``depth_m`` deep at ``x_m`` [m], one state per lumen pressure, and what is wanted of
    it. ``solving`` receives a line about each mesh before it is solved."""

    scene: Scene
    x_m: float
    depth_m: float
    pressures_pa: Sequence[float] = (0.0,)
    accuracy_pct: float = 1.0
    gradient: bool = False
    taxels: TaxelArray | None = None
    solving: Solving = lambda _what: None


Meshed = tuple[Any, list[Solution]]
"""A body on one mesh, and its states."""
Floor = tuple[Array, float]
"""What a mesh misses at least of force and pulse (2,) [%], and the power of the size that this
falls by."""


@dataclass(frozen=True)
class Refined:
    """What was solved, and the error left [%] of (force, pulse)."""

    solved: Meshed
    error_pct: Array

    def replaced_by(self, error_pct: Array, changed_pct: Array, budget_pct: Array) -> bool:
        """Whether a finer mesh, by which so much changed, states less, or shows this to be wrong.
        A first mesh states nothing."""
        if np.isinf(self.error_pct).any() or (changed_pct > self.error_pct).any():
            return True
        return bool((error_pct / budget_pct).max() <= (self.error_pct / budget_pct).max())


@dataclass(frozen=True)
class Meshes(ABC):
    """The meshes of a press, by their elements' ``share`` of a length of the finger."""

    asked: Asked

    @property
    @abstractmethod
    def name(self) -> str:
        """What is solved, for a person."""

    @property
    @abstractmethod
    def first_share(self) -> float:
        """Of the first mesh."""

    @abstractmethod
    def contact_m(self, share: float) -> float:
        """Element size in the contact [m]."""

    @abstractmethod
    def solve(self, share: float, coarser: Meshed | None, *, stated: bool) -> Meshed:
        """The press on a mesh; ``stated`` says that two coarser ones have stated their errors.
        Raises `CannotSolve`."""

    @abstractmethod
    def next_share(
        self, share: float, solved: Meshed, finer: float | None, budget_pct: Array
    ) -> float | None:
        """Of the mesh after ``solved``, where one ``finer`` by so much would do (None where only
        one is known); None where no mesh is worth it."""

    def left_pct(self, changed_pct: Array, ratio: float) -> Floor:
        """What a mesh misses that changed so much from one ``ratio`` times as coarse."""
        return changed_pct / (ratio**ORDER - 1), ORDER

    @abstractmethod
    def floors_pct(self, share: float, solved: Meshed) -> list[Floor]:
        """What it misses at least: two meshes may agree by chance."""

    def rough_pct(self, _solved: Meshed) -> float:
        """What of the pulse no finer mesh mends [%]."""
        return 0.0


def refine(meshes: Meshes, budget_pct: Array, near: Meshed | None = None) -> Refined:
    """Solve on ever finer ``meshes`` until the errors left are within ``budget_pct`` (force,
    pulse). Where a finer mesh states more than a coarser one, and does not show that to be wrong,
    the coarser one's answer and error are kept.

    The first mesh begins at what was solved ``near`` to it, where that is known. A mesh too fine to
    be solved, or to be worth it, ends the refinement too. Raises `CannotSolve`.
    """
    share, error_pct = meshes.first_share, np.full(2, np.inf)

    def solve(coarser: Meshed | None) -> Meshed:
        meshes.asked.solving(mesh_in_words(meshes.name, meshes.contact_m(share), error_pct))
        return meshes.solve(share, coarser, stated=bool(np.isfinite(error_pct).all()))

    solved = solve(near)
    best, finer = Refined(solved, error_pct), None
    while (after := meshes.next_share(share, solved, finer, budget_pct)) is not None:
        ratio, share, coarser = share / after, after, solved
        try:
            solved = solve(coarser)
        except CannotSolve:
            if finer is None:
                raise
            break
        changed_pct = changes_pct(_forces(coarser), _forces(solved))
        rough_pct = np.array([0.0, meshes.rough_pct(solved)])
        parts = [meshes.left_pct(changed_pct, ratio), *meshes.floors_pct(share, solved)]
        error_pct = np.max([part for part, _ in parts], axis=0)
        stated_pct = np.maximum(error_pct, rough_pct)
        enough_pct = np.maximum(budget_pct, rough_pct)
        if best.replaced_by(stated_pct, changed_pct, budget_pct):
            best = Refined(solved, stated_pct)
        if (error_pct <= enough_pct).all():
            break
        finer = max(float((part / enough_pct).max()) ** (1 / power) for part, power in parts)
    if best.error_pct[0] > WORTHLESS_PCT:
        raise CannotSolve(
            "mesh",
            f"forces differ by {best.error_pct[0]:.0f} % between meshes: walls fold so sharply "
            "that no mesh that can be solved settles it; press less deep",
        )
    return best


def mesh_in_words(name: str, contact_m: float, error_pct: Array) -> str:
    """What is solved next, for a person; ``error_pct`` (force, pulse) is not finite before two
    meshes are known."""
    words = f"{name} on elements of {1e3 * contact_m:.2g} mm under the finger"
    if np.isinf(error_pct).any():
        return words
    pulse = f", the pulse {error_pct[1]:.2g} %" if error_pct[1] else ""
    return f"{words}; so far the force is within {error_pct[0]:.2g} %{pulse}"


def _forces(solved: Meshed) -> Array:
    return np.array([state.force for state in solved[1]])


def changes_pct(coarse: Array, fine: Array) -> Array:
    """Largest change of the forces (n,), and that of their span over the pressures (2,) [%]."""
    largest = max(float(np.abs(fine).max()), 1e-12)
    of_span = abs(float(np.ptp(fine)) - float(np.ptp(coarse))) / pulse(fine)
    return 100 * np.array([np.abs(coarse - fine).max() / largest, of_span])


def pulse(forces: Array) -> float:
    """What a pulse's error is judged against."""
    return max(float(np.ptp(forces)), SMALL_PULSE * max(float(np.abs(forces).max()), 1e-12))
