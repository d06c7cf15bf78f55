"""What lies in the block, one table of a scene file each: lumps, arteries, narrowed arteries."""

from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from sim_backend.scene.table import Positive, Table

Poisson = Annotated[float, Field(ge=0, lt=0.5)]


class Stenosis(Table):
    """A concentric ring that takes ``fraction`` of the lumen's diameter."""

    fraction: Annotated[float, Field(gt=0, lt=1)]
    modulus_kpa: Positive
    z_mm: tuple[float, float] | None = None

    @field_validator("z_mm")
    @classmethod
    def _stretch(cls, ends: tuple[float, float] | None) -> tuple[float, float] | None:
        if ends is not None and ends[0] >= ends[1]:
            raise ValueError(f"[{ends[0]:g}, {ends[1]:g}]: the first must be below the second")
        return ends


class _Round(Table):
    x_mm: float
    depth_mm: Positive
    modulus_kpa: Positive
    poisson: Poisson

    @property
    def outer_radius_mm(self) -> float:
        raise NotImplementedError


class Tumour(_Round):
    """A round lump, glued to the tissue; a ball centred at ``z_mm`` in grids and solids (there 0
    if not given)."""

    kind: Literal["tumour"]
    diameter_mm: Positive
    z_mm: float | None = None

    @property
    def outer_radius_mm(self) -> float:
        return self.diameter_mm / 2


class Artery(_Round):
    """A tube with a lumen under pressure; ``path`` of [z_mm, x_mm, depth_mm] for grids."""

    kind: Literal["artery"]
    inner_diameter_mm: Positive
    wall_mm: Positive
    stenosis: Stenosis | None = None
    path: tuple[tuple[float, float, float], ...] = ()

    @property
    def outer_radius_mm(self) -> float:
        return self.inner_diameter_mm / 2 + self.wall_mm

    @model_validator(mode="after")
    def _wall(self) -> Self:
        if self.wall_mm > self.outer_radius_mm - 0.01:
            raise ValueError(
                f"wall_mm = {self.wall_mm:g} leaves no lumen: it must stay below the outer radius"
            )
        if self.path and any(b[0] <= a[0] for a, b in zip(self.path, self.path[1:], strict=False)):
            raise ValueError("path: z_mm must increase from point to point")
        return self


Inclusion = Annotated[Tumour | Artery, Field(discriminator="kind")]
