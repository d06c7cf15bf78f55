"""What is left out is left out because it is not felt, whatever the shape of scene and finger."""

import pytest

from sim_backend.models.choose import choose
from sim_backend.scene.scene_file import Scene

ROUND = {"shape": "cylinder", "radius_mm": 5.0}
WIDE = {"shape": "flat", "width_mm": 30.0, "edge_radius_mm": 2.0}
LUMP = {"kind": "tumour", "x_mm": 42.0, "depth_mm": 4.0, "diameter_mm": 5.0,
        "modulus_kpa": 1000.0, "poisson": 0.45}  # fmt: skip


def block(height_mm: float, indenter: dict[str, object], *inclusion: dict[str, object]) -> Scene:
    tissue = {"width_mm": 64.0, "height_mm": height_mm, "modulus_kpa": 50.0, "poisson": 0.45}
    return Scene.model_validate({"name": "block", "tissue": tissue, "indenter": indenter,
                                 "inclusion": inclusion})  # fmt: skip


@pytest.mark.parametrize("depth_mm", [0.2, 0.8])
def test_an_inclusion_under_a_wide_finger_stays(depth_mm: float) -> None:
    """Far from the finger's centre, in a thin block: without it the force is 19 % lower."""
    scene = block(8.0, WIDE, LUMP)
    assert choose(scene, 32.0, depth_mm, (0.0,), 1.0).scene == scene


@pytest.mark.parametrize("indenter", [WIDE, {"shape": "cylinder", "radius_mm": 20.0}])
def test_a_thin_block_is_not_taken_at_small_strain(indenter: dict[str, object]) -> None:
    """Shallow beside the finger, deep beside the block: small strain misses 14 % of the force."""
    assert choose(block(2.0, indenter), 32.0, 0.3, (0.0,), 1.0).model == "finite"


def test_what_is_not_felt_is_left_out_and_counted() -> None:
    far = LUMP | {"x_mm": 58.0, "diameter_mm": 3.0}
    choice = choose(block(16.83, ROUND, far), 16.0, 0.1, (0.0,), 1.0)
    assert choice.model == "small"
    assert choice.scene.inclusion == ()
    assert 0.0 < choice.error_pct <= 0.5
