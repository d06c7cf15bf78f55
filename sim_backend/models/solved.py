"""What a press answers, whatever kind of body it was solved as."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.body import Body
from sim_backend.fem.newton import Solution
from sim_backend.fem.picture import Picture
from sim_backend.fem.sensitivity import gradients
from sim_backend.models.bodies import BodyKind
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.taxels import TaxelArray


@dataclass(frozen=True)
class Solved:
    """A press into ``scene`` at ``x_m`` [m]: a ``body`` in one state per lumen pressure, n in all.

    ``error_pct`` (2,): what force and pulse, their span, may be off by [%]. ``model`` is an entry
    of `sim_backend.models.table`, and ``why`` says why it was taken. ``derivatives``: those of its
    forces are known.
    """

    scene: Scene
    x_m: float
    model: str
    kind: BodyKind
    body: Body
    states: tuple[Solution, ...]
    error_pct: Array
    why: str
    derivatives: bool = True

    @property
    def force_n_per_m(self) -> Array:
        """Force (n,) per length of the finger [N/m]; NaN of a body in space."""
        return self._force if self.kind.per_length else np.full(len(self.states), np.nan)

    @cached_property
    def force_n(self) -> Array:
        """Normal force (n,) [N] on the whole finger."""
        return self.kind.length_m(self.scene) * self._force

    @property
    def _force(self) -> Array:
        return np.array([state.force for state in self.states])

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
        ends = np.array([read(self.body, state) for state in self.states])
        return np.asarray(ends + [self.x_m, self.x_m, 0.0])  # noqa: RUF005

    @cached_property
    def least_volume_ratio(self) -> Array:
        """The smallest det F (n,)."""
        smallest = self.body.smallest_volume_ratio
        return np.array([smallest(state.displacement)[0] for state in self.states])

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
        by_length = {"indenter.length_mm": 1e-3 * self._force} if self.kind.per_length else {}
        return {key: length_m * one for key, one in by.items()} | by_length
