"""A ball on a stick."""

from math import pi
from typing import ClassVar, Literal

from sim_backend.scene.indenter.base import RoundIndenter
from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.table import Positive


class Sphere(RoundIndenter):
    """A ball on a stick as thick; solid scenes only."""

    tag: ClassVar = "sphere"
    shape: Literal["sphere"]
    radius_mm: Positive

    @property
    def profile(self) -> Profile:
        return Profile(((0.0, 0.0),), 1e-3 * self.radius_mm)

    @property
    def width_mm_projected(self) -> float:
        return 2 * self.radius_mm

    @property
    def face_mm2(self) -> float:
        return pi * self.radius_mm**2
