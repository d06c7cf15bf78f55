"""Where an emulated arm stands, and how far it reaches."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from sim_backend.arrays import Array
from sim_backend.emulators.ur.kinematics import Inverse, anywhere

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Mounting:
    """Where the scan frame lies in the robot's base frame, how far the arm reaches from there, and
    how far its joints turn."""

    origin_m: Point = (0.0, 0.0, 0.0)
    turn: Rotation = field(default_factory=Rotation.identity)
    reach_m: float = 10.0
    inverse: Inverse = anywhere
    joint_limit_rad: float = 2 * np.pi

    @cached_property
    def matrix(self) -> Array:
        """``turn`` as (3, 3): a tenth of its time on single vectors, 1500 times a second."""
        return np.asarray(self.turn.as_matrix())

    def to_base(self, place: Array) -> Array:
        """A place (3,) of the scan frame, in the base frame."""
        return np.asarray(np.array(self.origin_m) + self.matrix @ place)

    def to_scan(self, place: Array) -> Array:
        """A place (3,) of the base frame, in the scan frame."""
        return np.asarray((place - np.array(self.origin_m)) @ self.matrix)
