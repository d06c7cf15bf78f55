"""A flat finger of plane sections."""

from typing import ClassVar, Literal, Self

from pydantic import model_validator

from sim_backend.scene.indenter.base import Indenter
from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.indenter.skin import Skin, need_rounding_within, need_thin
from sim_backend.scene.table import Positive


class Flat(Indenter):
    """A flat finger with rounded edges; otherwise as `Cylinder`."""

    tag: ClassVar = "flat"
    planes: ClassVar[tuple[str, ...]] = ("stress", "strain")
    shape: Literal["flat"]
    width_mm: Positive
    edge_radius_mm: Positive
    length_mm: Positive = 10.0
    bonded: bool = False
    skin: Skin | None = None

    @property
    def profile(self) -> Profile:
        edge = 1e-3 * self.edge_radius_mm
        return Profile(((0.0, 0.0), (0.5e-3 * self.width_mm - edge, 0.0)), edge)

    @property
    def width_mm_projected(self) -> float:
        return self.width_mm

    @property
    def breadth_mm_projected(self) -> float:
        return self.length_mm

    @property
    def face_mm2(self) -> float:
        return self.width_mm * self.length_mm

    def need_solid(self) -> None:
        raise ValueError(
            "indenter.width_mm: a flat finger of a solid is round; give diameter_mm instead"
        )

    @model_validator(mode="after")
    def _edges(self) -> Self:
        need_rounding_within(self.edge_radius_mm, "width_mm", self.width_mm / 2)
        need_thin(self.skin, "half of width_mm", self.width_mm / 2)
        return self
