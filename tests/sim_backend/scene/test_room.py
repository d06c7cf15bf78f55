"""What lies in a block stays in it and overlaps nothing, all along a vessel's path."""

from typing import Any

import pytest
from pydantic import ValidationError
from small_solid import small_solid

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


@pytest.mark.parametrize("point, said", [
    ([20, 70, 12.0], r"inclusion\[0\] \(artery\): path\[1\]: x_mm = 70 breaks a side"),
    ([20, 32, 2.0], r"path\[1\]: depth_mm = 2 breaks the surface"),
    ([20, 32, 16.0], r"path\[1\]: depth_mm = 16 breaks the bottom"),
])  # fmt: skip
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


def solid(*paths: list[list[float]]) -> Scene:
    """A block of 30 x 12 x 20 mm with one vessel of radius 2 mm for each path."""
    vessel = {"kind": "artery", "inner_diameter_mm": 3.0, "wall_mm": 0.5, "modulus_kpa": 300.0,
              "poisson": 0.45}  # fmt: skip
    vessels = [vessel | {"x_mm": 15.0 + 8 * n, "depth_mm": 6.0, "path": path}
               for n, path in enumerate(paths)]  # fmt: skip
    return small_solid(30.0, 20.0, *vessels, height_mm=12.0)


@pytest.mark.parametrize("x_mm", [10.0, 12.1, 12.3, 17.1])
def test_a_path_at_just_45_degrees_is_taken(x_mm: float) -> None:
    assert solid([[-4.0, x_mm, 6.0], [4.0, x_mm + 8.0, 6.0]]).arteries[0].path
    with pytest.raises(ValidationError, match="at 45 degrees to z, at most 45"):
        solid([[-4.0, x_mm, 6.0], [4.0, x_mm + 8.001, 6.0]])


@pytest.mark.parametrize("path, said", [
    # at 45 degrees a radius of 2 mm is cut in an ellipse that reaches 2.828 mm
    ([[-4, 2.3, 6], [4, 10.2, 6]], r"path\[0\]: x_mm = 2.3 breaks a side; it must lie between 2.8"),
    ([[-4, 20, 6], [4, 27.5, 6]], r"path\[1\]: x_mm = 27.5 .* and 27.2"),
    ([[-4, 15, 2.5], [4, 15, 9]],
     r"path\[0\]: depth_mm = 2.5 breaks the surface; it must be above 2.5.*"),
    ([[-4, 15, 2.7], [4, 15, 9.5]],
     r"path\[1\]: depth_mm = 9.5 breaks the bottom; it must be below 9.3"),
])  # fmt: skip
def test_an_oblique_vessel_needs_room_for_its_cut(path: list[list[float]], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        solid(path)


def test_between_oblique_vessels_there_is_room_for_their_cuts() -> None:
    def beside(x_mm: float) -> Scene:
        return solid([[-4, 8, 6], [4, 16, 6]], [[-4, 8 + x_mm, 6], [4, 16 + x_mm, 6]])

    with pytest.raises(ValidationError, match=r"overlaps .* 5.6 mm apart; .* more than 5.65"):
        beside(5.6)  # 4 mm would do if they were straight
    assert beside(5.7)
    # above each other they are no wider for leaning aside
    assert solid([[-4, 8, 2.9], [4, 16, 2.9]], [[-4, 8, 7.0], [4, 16, 7.0]])


def test_a_path_of_one_point_is_straight() -> None:
    assert solid([[0, 8, 6]], [[0, 12.1, 6]])
    with pytest.raises(ValidationError, match="overlaps"):
        solid([[0, 8, 6]], [[0, 11.9, 6]])


def test_a_plane_section_s_vessel_is_round_where_its_path_leans() -> None:
    assert scene([[0, 3.0, 12.0], [4, 7.0, 12.0]])
