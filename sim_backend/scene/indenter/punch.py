"""A round flat finger."""

from math import pi
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from sim_backend.scene.indenter.base import RoundIndenter, Tilt
from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.indenter.skin import need_rounding_within
from sim_backend.scene.table import Positive


class Punch(RoundIndenter):
    """A round flat finger of an overall ``diameter_mm`` with a rounded edge, which may lean; solid
    scenes only."""

    tag: ClassVar = "round flat"
    shape: Literal["flat"]
    diameter_mm: Positive
    edge_radius_mm: Positive
    tilt_deg: Tilt = None

    @property
    def profile(self) -> Profile:
        edge = 1e-3 * self.edge_radius_mm
        return Profile(((0.0, 0.0), (0.5e-3 * self.diameter_mm - edge, 0.0)), edge)

    @property
    def width_mm_projected(self) -> float:
        return self.diameter_mm

    @property
    def face_mm2(self) -> float:
        return pi * self.diameter_mm**2 / 4

    @model_validator(mode="after")
    def _edge(self) -> Self:
        need_rounding_within(self.edge_radius_mm, "diameter_mm", self.diameter_mm / 2)
        return self
