"""The fingers that a scene file may name.

A plane scene takes ``cylinder`` and ``flat``, which its section cuts across; a solid one
``sphere``, ``cylinder`` with its ends and the round ``flat`` punch.
"""

from math import pi
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, Discriminator, Field, Tag, model_validator

from sim_backend.scene.table import Positive, Table, is_unset


class Skin(Table):
    """A thin soft layer on the finger, inside its outline. It gives way where it is pressed and
    only there (elastic foundation), which an incompressible layer does not."""

    thickness_mm: Positive
    modulus_kpa: Positive
    poisson: Annotated[float, Field(ge=0, le=0.45)] = 0.3

    @property
    def m_per_pa(self) -> float:
        """How much the layer gives way under a pressure, not bulging sideways (Johnson 1985,
        Contact Mechanics, section 4.3)."""
        nu = self.poisson
        confined = (1 - nu) / ((1 + nu) * (1 - 2 * nu)) * 1e3 * self.modulus_kpa
        return 1e-3 * self.thickness_mm / confined


Tilt = Annotated[float | None, Field(ge=-45, le=45, exclude_if=is_unset)]
"""How far a solid's finger leans in the plane of the section [deg], its top towards larger x, about
the middle of its underside, which stays over the place."""


class Cylinder(Table):
    """A round finger, rigid under its skin if it has one. ``bonded``: what it touches sticks.

    In a solid its ends count: ``length_mm`` is overall, ``edge_radius_mm`` rounds the ends (needed
    there), and its ``axis`` lies along the vessels or across them; one across may lean.
    """

    shape: Literal["cylinder"] = "cylinder"
    radius_mm: Positive = 5.0
    length_mm: Positive = 10.0
    edge_radius_mm: Annotated[Positive | None, Field(exclude_if=is_unset)] = None
    axis: Annotated[Literal["along", "across"] | None, Field(exclude_if=is_unset)] = None
    tilt_deg: Tilt = None
    bonded: bool = False
    skin: Skin | None = None

    @property
    def width_mm_projected(self) -> float:
        return self.length_mm if self.axis == "across" else 2 * self.radius_mm

    @property
    def breadth_mm_projected(self) -> float:
        """Extent along the vessels."""
        return 2 * self.radius_mm if self.axis == "across" else self.length_mm

    @property
    def face_mm2(self) -> float:
        """Projected area."""
        return 2 * self.radius_mm * self.length_mm

    @model_validator(mode="after")
    def _shape(self) -> Self:
        _thin_skin(self.skin, "radius_mm", self.radius_mm)
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


class Flat(Table):
    """A flat finger with rounded edges; otherwise as `Cylinder`."""

    shape: Literal["flat"]
    width_mm: Positive
    edge_radius_mm: Positive
    length_mm: Positive = 10.0
    bonded: bool = False
    skin: Skin | None = None

    @property
    def width_mm_projected(self) -> float:
        return self.width_mm

    @property
    def breadth_mm_projected(self) -> float:
        """Extent along the vessels."""
        return self.length_mm

    @property
    def face_mm2(self) -> float:
        """Projected area."""
        return self.width_mm * self.length_mm

    @model_validator(mode="after")
    def _edges(self) -> Self:
        if self.edge_radius_mm > self.width_mm / 2:
            raise ValueError(
                f"edge_radius_mm = {self.edge_radius_mm:g} must not exceed half of width_mm"
            )
        _thin_skin(self.skin, "half of width_mm", self.width_mm / 2)
        return self


class _Bare(Table):
    """A finger without a skin, on which nothing sticks."""

    @property
    def bonded(self) -> bool:
        return False

    @property
    def width_mm_projected(self) -> float:
        raise NotImplementedError

    @property
    def breadth_mm_projected(self) -> float:
        """Extent along the vessels: round fingers are as broad as wide."""
        return self.width_mm_projected

    @property
    def skin(self) -> None:
        return None


class Sphere(_Bare):
    """A ball on a stick; solid scenes only."""

    shape: Literal["sphere"]
    radius_mm: Positive

    @property
    def length_mm(self) -> float:
        """How far it extends along the vessels."""
        return 2 * self.radius_mm

    @property
    def width_mm_projected(self) -> float:
        return 2 * self.radius_mm

    @property
    def face_mm2(self) -> float:
        """Projected area."""
        return pi * self.radius_mm**2


class Punch(_Bare):
    """A round flat finger of an overall ``diameter_mm`` with a rounded edge, which may lean; solid
    scenes only."""

    shape: Literal["flat"]
    diameter_mm: Positive
    edge_radius_mm: Positive
    tilt_deg: Tilt = None

    @property
    def length_mm(self) -> float:
        """How far it extends along the vessels."""
        return self.diameter_mm

    @property
    def width_mm_projected(self) -> float:
        return self.diameter_mm

    @property
    def face_mm2(self) -> float:
        """Projected area."""
        return pi * self.diameter_mm**2 / 4

    @model_validator(mode="after")
    def _edge(self) -> Self:
        if self.edge_radius_mm > self.diameter_mm / 2:
            raise ValueError(
                f"edge_radius_mm = {self.edge_radius_mm:g} must not exceed half of diameter_mm"
            )
        return self


def leaning_deg(finger: "Indenter") -> float:
    """`Tilt` of a finger; of those that have none 0."""
    return finger.tilt_deg or 0.0 if isinstance(finger, Cylinder | Punch) else 0.0


def mirrored_finger(finger: "Indenter") -> "Indenter":
    """The finger seen from the other side along the vessels."""
    lean = leaning_deg(finger)
    return finger.model_copy(update={"tilt_deg": -lean}) if lean else finger


def _thin_skin(skin: Skin | None, name: str, half_mm: float) -> None:
    if skin is not None and skin.thickness_mm > half_mm / 4:
        raise ValueError(
            f"skin.thickness_mm = {skin.thickness_mm:g}: at most a quarter of {name}, "
            f"{half_mm / 4:g}"
        )


def _kind(finger: Any) -> str | None:
    """Which finger a table means: a ``flat`` with a diameter is round."""
    keys = vars(finger) if isinstance(finger, BaseModel) else finger
    if not isinstance(keys, dict):
        return None
    shape = keys.get("shape", "cylinder")
    return "round flat" if shape == "flat" and "diameter_mm" in keys else shape


Indenter = Annotated[
    Annotated[Cylinder, Tag("cylinder")]
    | Annotated[Flat, Tag("flat")]
    | Annotated[Sphere, Tag("sphere")]
    | Annotated[Punch, Tag("round flat")],
    Discriminator(
        _kind,
        custom_error_type="finger",
        custom_error_message="shape must be cylinder, flat or (in a solid) sphere",
    ),
]
