"""What lies in the block, one table of a scene file each: lumps, arteries, narrowed arteries."""

from typing import Annotated, Literal, Self

import numpy as np
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

    def centre_mm(self, _z_mm: float) -> tuple[float, float]:
        """x and depth of the centre in the section at z."""
        return self.x_mm, self.depth_mm


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
    """A tube with a lumen under pressure; ``path`` of [z_mm, x_mm, depth_mm] for grids and
    solids."""

    kind: Literal["artery"]
    inner_diameter_mm: Positive
    wall_mm: Positive
    stenosis: Stenosis | None = None
    path: tuple[tuple[float, float, float], ...] = ()

    @property
    def outer_radius_mm(self) -> float:
        return self.inner_diameter_mm / 2 + self.wall_mm

    def centre_mm(self, z_mm: float) -> tuple[float, float]:
        """x and depth of the centre in the section at z: of a path, constant beyond its ends."""
        if not self.path:
            return super().centre_mm(z_mm)
        z, x, depth = np.array(self.path).T
        return float(np.interp(z_mm, z, x)), float(np.interp(z_mm, z, depth))

    @model_validator(mode="after")
    def _wall(self) -> Self:
        if self.wall_mm > self.outer_radius_mm - 0.01:
            raise ValueError(
                f"wall_mm = {self.wall_mm:g} leaves no lumen: it must stay 0.01 mm below the outer "
                f"radius of {self.outer_radius_mm:g} mm"
            )
        if self.path and any(b[0] <= a[0] for a, b in zip(self.path, self.path[1:], strict=False)):
            raise ValueError("path: z_mm must increase from point to point")
        return self


Inclusion = Annotated[Tumour | Artery, Field(discriminator="kind")]
