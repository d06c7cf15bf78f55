"""What every finger of a scene file says of itself."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple, Self

from pydantic import Field, model_validator

from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.indenter.skin import Skin, need_thin
from sim_backend.scene.table import Table, is_unset

Tilt = Annotated[float | None, Field(ge=-45, le=45, exclude_if=is_unset)]
"""How far a solid's finger leans in the plane of the section [deg], its top towards larger x, about
the middle of its underside, which stays over the place."""


class Lying(NamedTuple):
    """A finger turned about an ``axis`` that lies: its ``radius`` [m] and ``outline`` along it."""

    axis: tuple[float, float, float]
    radius: float
    outline: Profile


class Indenter(Table, ABC):
    """A finger by its outline: all that decks, pictures, windows, meshes and contact ask.

    A new shape is a file in this folder with a subclass that has ``tag``, ``planes``, ``shape`` and
    its keys, ``profile`` and the two projected sizes. In a solid it is the profile turned about an
    upright axis, unless ``lies``.
    """

    tag: ClassVar[str]
    """The name that tells it from the other shapes."""
    planes: ClassVar[tuple[str, ...]]
    """Which of plane ("stress", "strain") and "solid" scenes know it."""

    if TYPE_CHECKING:  # fields of some fingers, properties of others

        @property
        def shape(self) -> str: ...
        @property
        def length_mm(self) -> float: ...
        @property
        def bonded(self) -> bool: ...
        @property
        def skin(self) -> Skin | None: ...

    @property
    @abstractmethod
    def profile(self) -> Profile:
        """The outline across the vessels."""

    @property
    def ends(self) -> Profile:
        """The outline along the vessels; a round finger's is its profile."""
        return self.profile

    @property
    def lies(self) -> Lying | None:
        """How one lies on its side that does not stand."""
        return None

    @property
    @abstractmethod
    def width_mm_projected(self) -> float:
        """Extent across the vessels [mm]."""

    @property
    @abstractmethod
    def breadth_mm_projected(self) -> float:
        """Extent along the vessels [mm]."""

    @property
    @abstractmethod
    def face_mm2(self) -> float:
        """Projected area."""

    @property
    def leaning_deg(self) -> float:
        """`Tilt`; of those that have none 0."""
        return getattr(self, "tilt_deg", None) or 0.0

    @property
    def turns(self) -> bool:
        """Whether a solid's finger is one of revolution about an upright axis."""
        return "solid" in self.planes and self.lies is None and not self.leaning_deg

    def only_in_a_solid(self) -> dict[str, object]:
        """The keys that are set and that a plane section does not know."""
        keys = ("axis", "tilt_deg") if "stress" in self.planes else ("shape",)
        return {key: getattr(self, key, None) for key in keys}

    def need_solid(self) -> None:
        """Raise ValueError for what a solid's finger cannot be."""
        if "solid" not in self.planes:
            raise ValueError(f"indenter.shape = {self.shape}: in plane scenes only")

    def mirrored(self) -> Self:
        """The finger seen from the other side along the vessels."""
        lean = self.leaning_deg
        return self.model_copy(update={"tilt_deg": -lean}) if lean else self


class RoundIndenter(Indenter):
    """A solid's finger of revolution, as broad as wide. ``bonded``: what it touches sticks."""

    planes: ClassVar[tuple[str, ...]] = ("solid",)
    bonded: bool = False
    skin: Skin | None = None

    @model_validator(mode="after")
    def _skin(self) -> Self:
        need_thin(self.skin, "half of the width", self.width_mm_projected / 2)
        return self

    @property
    def length_mm(self) -> float:
        return self.width_mm_projected

    @property
    def breadth_mm_projected(self) -> float:
        return self.width_mm_projected
