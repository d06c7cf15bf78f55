"""What lies in a block stays in it and overlaps nothing, all along a vessel's path."""

from typing import Any

import pytest
from pydantic import ValidationError

from sim_backend.scene.scene_file import Scene, load_scene

TIHA = load_scene("TIHA")


def scene(*paths: list[list[float]], **also: Any) -> Scene:
    """The block of TIHA with one vessel for each path."""
    (vessel,) = TIHA.model_dump(exclude_none=True)["inclusion"]
    table = TIHA.model_dump(exclude_none=True)
    table["inclusion"] = [
        vessel | {"x_mm": path[0][1], "depth_mm": path[0][2], "path": path} for path in paths
    ] + also.get("beside", [])
    return Scene.model_validate(table)


@pytest.mark.parametrize(
    ("point", "said"),
    [
        ([20, 70, 12.0], r"inclusion\[0\] \(artery\): path\[1\]: x_mm = 70 breaks a side"),
        ([20, 32, 2.0], r"path\[1\]: depth_mm = 2 breaks the surface"),
        ([20, 32, 16.0], r"path\[1\]: depth_mm = 16 breaks the bottom"),
    ],
)
def test_a_path_stays_in_the_block(point: list[float], said: str) -> None:
    assert scene([[0, 20, 12.0], [20, 32, 12.0]]).arteries[0].path
    with pytest.raises(ValidationError, match=said):
        scene([[0, 20, 12.0], point])


def test_vessels_that_cross_between_the_points_of_their_paths_overlap() -> None:
    with pytest.raises(ValidationError, match=r"inclusion\[1\] .* overlaps .* 0 mm apart"):
        scene([[0, 20, 12.0], [20, 40, 12.0]], [[0, 40, 12.0], [20, 20, 12.0]])
    assert scene([[0, 20, 12.0], [20, 30, 12.0]], [[0, 32, 12.0], [20, 42, 12.0]])


def test_a_path_that_runs_into_a_lump_overlaps() -> None:
    lump = {"kind": "tumour", "x_mm": 45, "depth_mm": 12, "diameter_mm": 4, "modulus_kpa": 1000,
            "poisson": 0.49}  # fmt: skip
    assert scene([[0, 20, 12.0], [20, 30, 12.0]], beside=[lump])
    with pytest.raises(ValidationError, match="overlaps"):
        scene([[0, 20, 12.0], [20, 60, 12.0]], beside=[lump])
