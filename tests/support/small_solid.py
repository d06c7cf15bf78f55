"""A small block in space under a ball: solved in seconds."""

from typing import Any

from sim_backend import Scene


def small_solid(
    width_mm: float, length_mm: float, *inclusion: dict[str, Any], height_mm: float = 8.0,
    poisson: float = 0.45, ball_mm: float = 4.0, indenter: dict[str, Any] | None = None,
    **tissue: Any,
) -> Scene:  # fmt: skip
    """The block over what lies in it; ``tissue``: other keys of its table."""
    return Scene.model_validate({
        "name": "small", "plane": "solid",
        "tissue": {"width_mm": width_mm, "height_mm": height_mm, "length_mm": length_mm,
                   "modulus_kpa": 50.0, "poisson": poisson, **tissue},
        "inclusion": inclusion,
        "indenter": indenter or {"shape": "sphere", "radius_mm": ball_mm},
    })  # fmt: skip


def vessel(x_mm: float) -> dict[str, Any]:
    """One for such a block."""
    return {"kind": "artery", "x_mm": x_mm, "depth_mm": 4.5, "inner_diameter_mm": 2.0,
            "wall_mm": 1.0, "modulus_kpa": 200.0, "poisson": 0.45}  # fmt: skip
