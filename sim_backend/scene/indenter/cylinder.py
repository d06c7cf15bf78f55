"""A round finger that lies along the vessels or across them."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from sim_backend.scene.indenter.base import Indenter, Lying, Tilt
from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.indenter.skin import Skin, need_thin
from sim_backend.scene.table import Positive, is_unset


class Cylinder(Indenter):
    """A round finger, rigid under its skin if it has one. ``bonded``: what it touches sticks.

    In a solid its ends count: ``length_mm`` is overall, ``edge_radius_mm`` rounds the ends (needed
    there), and its ``axis`` lies along the vessels or across them; one across may lean.
    """

    tag: ClassVar = "cylinder"
    planes: ClassVar[tuple[str, ...]] = ("stress", "strain", "solid")
    shape: Literal["cylinder"] = "cylinder"
    radius_mm: Positive = 5.0
    length_mm: Positive = 10.0
    edge_radius_mm: Annotated[Positive | None, Field(exclude_if=is_unset)] = None
    axis: Annotated[Literal["along", "across"] | None, Field(exclude_if=is_unset)] = None
    tilt_deg: Tilt = None
    bonded: bool = False
    skin: Skin | None = None

    @property
    def profile(self) -> Profile:
        return self._end if self.axis == "across" else self._side

    @property
    def ends(self) -> Profile:
        return self._side if self.axis == "across" else self._end

    @property
    def lies(self) -> Lying:
        axis = (1.0, 0.0, 0.0) if self.axis == "across" else (0.0, 0.0, 1.0)
        return Lying(axis, 1e-3 * self.radius_mm, self._end)

    @property
    def _side(self) -> Profile:
        return Profile(((0.0, 0.0),), 1e-3 * self.radius_mm)

    @property
    def _end(self) -> Profile:
        edge = 1e-3 * (self.edge_radius_mm or 0.0)
        return Profile(((0.0, 0.0), (0.5e-3 * self.length_mm - edge, 0.0)), edge)

    @property
    def width_mm_projected(self) -> float:
        return self.length_mm if self.axis == "across" else 2 * self.radius_mm

    @property
    def breadth_mm_projected(self) -> float:
        return 2 * self.radius_mm if self.axis == "across" else self.length_mm

    @property
    def face_mm2(self) -> float:
        return 2 * self.radius_mm * self.length_mm

    def only_in_a_solid(self) -> dict[str, object]:
        return super().only_in_a_solid() | {"edge_radius_mm": self.edge_radius_mm}

    def need_solid(self) -> None:
        super().need_solid()
        if self.edge_radius_mm is None:
            raise ValueError(
                "indenter.edge_radius_mm is missing: a solid's cylinder has rounded ends"
            )

    @model_validator(mode="after")
    def _shape(self) -> Self:
        need_thin(self.skin, "radius_mm", self.radius_mm)
        if self.tilt_deg and self.axis != "across":
            raise ValueError(
                f"tilt_deg = {self.tilt_deg:g} turns a cylinder along the vessels about itself; "
                'take axis = "across", or leave it out'
            )
        most = min(self.radius_mm, self.length_mm / 2)
        if self.edge_radius_mm is not None and self.edge_radius_mm > most:
            raise ValueError(
                f"edge_radius_mm = {self.edge_radius_mm:g} must not exceed {most:g}, the smaller "
                "of radius_mm and half of length_mm"
            )
        return self
