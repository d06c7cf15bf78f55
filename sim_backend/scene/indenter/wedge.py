"""A blunt wedge in a plane section, and in a solid the cone that it makes turned about its axis."""

from math import pi, radians, tan
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from sim_backend.scene.indenter.base import Indenter, RoundIndenter
from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.indenter.skin import Skin, need_thin
from sim_backend.scene.table import Positive

Angle = Annotated[float, Field(ge=30, lt=180)]
"""Between both flanks [deg]. The limit pressure of a sharper one is not the tissue's elasticity."""


class Wedge(Indenter):
    """A wedge of ``angle_deg`` between its flanks and ``width_mm`` overall, its edge rounded by
    ``tip_radius_mm``; plane scenes only. Otherwise as `Cylinder`."""

    tag: ClassVar = "wedge"
    planes: ClassVar[tuple[str, ...]] = ("stress", "strain")
    shape: Literal["wedge"]
    angle_deg: Angle
    tip_radius_mm: Positive
    width_mm: Positive
    length_mm: Positive = 10.0
    bonded: bool = False
    skin: Skin | None = None

    @property
    def profile(self) -> Profile:
        return blunt_point(self.angle_deg, self.tip_radius_mm, self.width_mm)

    @property
    def width_mm_projected(self) -> float:
        return self.width_mm

    @property
    def breadth_mm_projected(self) -> float:
        return self.length_mm

    @property
    def face_mm2(self) -> float:
        return self.width_mm * self.length_mm

    @model_validator(mode="after")
    def _tip(self) -> Self:
        need_room_for_flanks(self.tip_radius_mm, "width_mm", self.width_mm)
        need_thin(self.skin, "tip_radius_mm", self.tip_radius_mm)
        return self


class Cone(RoundIndenter):
    """A cone of ``angle_deg`` at its point, which is rounded by ``tip_radius_mm``, and an overall
    ``diameter_mm``; solid scenes only."""

    tag: ClassVar = "cone"
    shape: Literal["cone"]
    angle_deg: Angle
    tip_radius_mm: Positive
    diameter_mm: Positive

    @property
    def profile(self) -> Profile:
        return blunt_point(self.angle_deg, self.tip_radius_mm, self.diameter_mm)

    @property
    def width_mm_projected(self) -> float:
        return self.diameter_mm

    @property
    def face_mm2(self) -> float:
        return pi * self.diameter_mm**2 / 4

    @model_validator(mode="after")
    def _tip(self) -> Self:
        need_room_for_flanks(self.tip_radius_mm, "diameter_mm", self.diameter_mm)
        return self


def blunt_point(angle_deg: float, tip_radius_mm: float, width_mm: float) -> Profile:
    """Flanks that meet at an angle and end at a width, all of it rounded by the tip's radius."""
    aside = 0.5e-3 * width_mm - 1e-3 * tip_radius_mm
    return Profile(((0.0, 0.0), (aside, aside / tan(radians(angle_deg) / 2))), 1e-3 * tip_radius_mm)


def need_room_for_flanks(tip_radius_mm: float, name: str, width_mm: float) -> None:
    """Raise ValueError where the rounded point is as wide as the finger."""
    if tip_radius_mm >= width_mm / 2:
        raise ValueError(
            f"tip_radius_mm = {tip_radius_mm:g} must be below half of {name}, {width_mm / 2:g}"
        )
