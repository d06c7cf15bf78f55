"""A soft skin on a finger."""

from typing import Annotated

from pydantic import Field

from sim_backend.scene.table import Positive, Table


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


def need_thin(skin: Skin | None, name: str, half_mm: float) -> None:
    """Raise ValueError for a skin thicker than a quarter of ``half_mm``, the finger's ``name``."""
    if skin is not None and skin.thickness_mm > half_mm / 4:
        raise ValueError(
            f"skin.thickness_mm = {skin.thickness_mm:g}: at most a quarter of {name}, "
            f"{half_mm / 4:g}"
        )


def need_rounding_within(edge_mm: float | None, name: str, half_mm: float) -> None:
    """Raise ValueError for an edge that is rounded by more than ``half_mm``, half of ``name``."""
    if edge_mm is not None and edge_mm > half_mm:
        raise ValueError(f"edge_radius_mm = {edge_mm:g} must not exceed half of {name}")
