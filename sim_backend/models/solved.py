"""What a press answers, whatever kind of body it was solved as."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import nan
from typing import Any

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem import stress
from sim_backend.fem.body import Body
from sim_backend.fem.model import best_element
from sim_backend.fem.newton import Solution
from sim_backend.fem.picture import Picture, SectionPicture
from sim_backend.fem.sensitivity import gradients
from sim_backend.fem.solid import stress as solid_stress
from sim_backend.fem.solid.cut import Cut
from sim_backend.fem.taxels import section_taxels_n, solid_taxels_n, turned_taxels_n
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.taxels import TaxelArray


@dataclass(frozen=True)
class BodyKind:
    """How a solution of a kind of body is read.

    ``length_m`` is what `Solution.force` is to be multiplied by, NaN where it is the whole
    finger's; ``contact_m`` takes the place [m] too, and ``taxels_n`` the edges across and along,
    and the finger's length [m].
    """

    element: Callable[[Scene], str]
    length_m: Callable[[Scene], float]
    von_mises_pa: Callable[[Any, Array], float]
    contact_m: Callable[[Any, Solution, float], tuple[float, float, float]]
    taxels_n: Callable[[Any, Solution, Array, Array, float], Array]
    picture: Callable[[Any], Picture]


def _finger_m(scene: Scene) -> float:
    return 1e-3 * scene.indenter.length_mm


def _whole(_: Scene) -> float:
    return nan


def _wedges(_: Scene) -> str:
    return "wedge"


def _section_contact_m(body: Any, state: Solution, _: float) -> tuple[float, float, float]:
    return stress.contact_m(body, state)


def _turned_contact_m(body: Any, state: Solution, x_m: float) -> tuple[float, float, float]:
    _, radius_m, off_m = stress.contact_m(body, state)
    return x_m - radius_m, x_m + radius_m, off_m


def _solid_contact_m(body: Any, state: Solution, _: float) -> tuple[float, float, float]:
    return solid_stress.contact_m(body, state)


def _turned_taxels_n(body: Any, state: Solution, across: Array, along: Array, _: float) -> Array:
    return turned_taxels_n(body, state, across, along)


def _solid_taxels_n(body: Any, state: Solution, across: Array, along: Array, _: float) -> Array:
    return solid_taxels_n(body, state, across, along)


# Functions with names: a press goes to other processes.
SECTION = BodyKind(
    best_element, _finger_m, stress.under_finger_pa, _section_contact_m, section_taxels_n,
    SectionPicture,
)  # fmt: skip
REVOLVED = BodyKind(
    best_element, _whole, stress.under_finger_pa, _turned_contact_m, _turned_taxels_n,
    SectionPicture,
)  # fmt: skip
SOLID = BodyKind(
    _wedges, _whole, solid_stress.under_finger_pa, _solid_contact_m, _solid_taxels_n, Cut
)


@dataclass(frozen=True)
class Solved:
    """A press into ``scene`` at ``x_m`` [m]: a ``body`` in one state per lumen pressure, n in all.

    ``error_pct`` (2,): what force and pulse, their span, may be off by [%]. ``model`` is an entry
    of `sim_backend.models.table`, ``why`` says why it was taken, and ``left_out`` how many
    inclusions it does not see. ``derivatives``: those of its forces are known.
    """

    scene: Scene
    x_m: float
    model: str
    kind: BodyKind
    body: Body
    states: tuple[Solution, ...]
    error_pct: Array
    why: str
    left_out: int = 0
    derivatives: bool = True

    @property
    def force_n_per_m(self) -> Array:
        """Force (n,) per length of the finger [N/m]; NaN of a body in space."""
        return self.force_n / self.kind.length_m(self.scene)

    @cached_property
    def force_n(self) -> Array:
        """Normal force (n,) [N] on the whole finger."""
        length_m = self.kind.length_m(self.scene)
        force = np.array([state.force for state in self.states])
        return force if np.isnan(length_m) else length_m * force

    @cached_property
    def von_mises_pa(self) -> Array:
        """Von Mises stress (n,) [Pa] at the surface under the finger."""
        read = self.kind.von_mises_pa
        return np.array([read(self.body, state.displacement) for state in self.states])

    @cached_property
    def contact_m(self) -> Array:
        """Left and right end of what the finger touches, twice its middle where none, and what
        either may be off by (n, 3) [m]."""
        read = self.kind.contact_m
        return np.array([read(self.body, state, self.x_m) for state in self.states])

    @cached_property
    def least_volume_ratio(self) -> Array:
        """The smallest det F (n,)."""
        smallest = self.body.smallest_volume_ratio
        return np.array([smallest(state.displacement)[0] for state in self.states])

    @property
    def stable(self) -> list[bool | None]:
        """Whether each state would stay so if it were nudged; None where that is not decided."""
        return [state.stable for state in self.states]

    @property
    def picture(self) -> Picture:
        """What a picture shows of the body and each of ``states``."""
        return self.kind.picture(self.body)

    def taxels_n(self, array: TaxelArray) -> Array:
        """The part of each force (n, rows, columns) [N] on each taxel of an array."""
        finger = self.scene.indenter
        across_m, along_m = array.edges_m(finger)
        length_m, read = 1e-3 * finger.length_mm, self.kind.taxels_n
        return np.array([
            read(self.body, state, across_m, along_m, length_m) for state in self.states
        ])  # fmt: skip

    @cached_property
    def gradient(self) -> Mapping[str, Array]:
        """How much each force (n,) changes [N] for one more of each number of the scene, and of
        ``x_mm``, ``depth_mm`` and ``pressure_mmhg``, the contact as it is.

        Raises `SceneError` where its model does not know them, and that and `SingularMatrix` as
        `sim_backend.fem.sensitivity.gradients`.
        """
        if not self.derivatives:
            raise SceneError(f"{self.scene.name}: no gradient is known of a press by {self.model}")
        each = [gradients(self.body, state, self.scene) for state in self.states]
        by = {key: np.array([state[key] for state in each]) for key in each[0]}
        length_m = self.kind.length_m(self.scene)
        if np.isnan(length_m):
            return by
        per_length = np.array([1e-3 * state.force for state in self.states])
        return {key: length_m * one for key, one in by.items()} | {"indenter.length_mm": per_length}
