"""Solid scenes: what they need, what plane scenes refuse, and what ships."""

from typing import Any

import pytest

from sim_backend.fem.axisymmetric import is_round
from sim_backend.fem.model import build_section
from sim_backend.models.press import press
from sim_backend.models.station_response import station
from sim_backend.scene.inclusion import Artery
from sim_backend.scene.indenter import Punch, Sphere
from sim_backend.scene.scene_file import (
    Scene,
    SceneError,
    load_scene,
    mirrored,
    scene_from_text,
    scene_names,
)
from sim_backend.scene.slicing import section_at, under_finger

SOLID = """
name = "mine"
plane = "solid"
[tissue]
width_mm = 64.0
height_mm = 16.83
length_mm = 40.0
modulus_kpa = 50.0
poisson = 0.49
"""
SPHERE = '[indenter]\nshape = "sphere"\nradius_mm = 5.0\n'
STENOSED = """
[[inclusion]]
kind = "artery"
x_mm = 32.0
depth_mm = 9.0
inner_diameter_mm = 4.5
wall_mm = 0.63
modulus_kpa = 400.0
poisson = 0.49
stenosis = {{fraction = 0.3, modulus_kpa = 4000.0, z_mm = {}}}
"""


def test_each_scene_in_tissue_has_a_solid_twin() -> None:
    for name in scene_names():
        scene = load_scene(name)
        if scene.plane == "solid" or scene.tissue is None:
            continue
        twin = load_scene(f"{name}-solid")
        assert twin.plane == "solid" and twin.tissue is not None
        flat = twin.tissue.model_copy(update={"length_mm": None, "ends": None})
        assert flat == scene.tissue and twin.pulse == scene.pulse
        assert [(one.x_mm, one.depth_mm) for one in twin.inclusion] == [
            (one.x_mm, one.depth_mm) for one in scene.inclusion
        ]


def test_a_plane_scene_writes_no_key_of_solids() -> None:
    table = load_scene("TIHA").model_dump(mode="json")
    assert set(table["tissue"]) == {"width_mm", "height_mm", "modulus_kpa", "poisson", "relaxation"}
    assert set(table["indenter"]) == {"shape", "radius_mm", "length_mm", "bonded", "skin"}


def test_round_fingers() -> None:
    ball = scene_from_text(SOLID + SPHERE, "a")
    assert isinstance(ball.indenter, Sphere)
    assert ball.face_mm2 == pytest.approx(78.54, abs=0.01)
    flat = '[indenter]\nshape = "flat"\ndiameter_mm = 8.0\nedge_radius_mm = 1.0\n'
    punch = scene_from_text(SOLID + flat, "a")
    assert isinstance(punch.indenter, Punch)
    assert punch.face_mm2 == pytest.approx(50.27, abs=0.01)


@pytest.mark.parametrize("text, key", [
    (SOLID.replace("length_mm = 40.0\n", "") + SPHERE, "tissue.length_mm is missing"),
    (SOLID, "indenter.edge_radius_mm is missing"),
    (SOLID.replace('"solid"', '"strain"'), 'length_mm = 40.0: only with plane = "solid"'),
    (SOLID.replace('"solid"', '"stress"').replace("length_mm = 40.0\n", "") + SPHERE,
     'shape = sphere: only with plane = "solid"'),
    (SOLID + '[indenter]\nshape = "flat"\nwidth_mm = 8.0\nedge_radius_mm = 1.0\n',
     "give diameter_mm instead"),
    (SOLID + '[indenter]\nshape = "cylinder"\nlength_mm = 10.0\nedge_radius_mm = 5.5\n',
     "must not exceed 5"),
    (
        SOLID + SPHERE + '[[inclusion]]\nkind = "tumour"\nx_mm = 32.0\ndepth_mm = 8.0\n'
        "z_mm = 18.0\ndiameter_mm = 5.0\nmodulus_kpa = 500.0\npoisson = 0.49\n",
        "must stay within 17.5 of 0",
    ),
    (SOLID + SPHERE + STENOSED.format("[4.0, -4.0]"), "first must be below the second"),
    (SOLID + SPHERE + STENOSED.format("[4.0, 4.0]"), "first must be below the second"),
    (SOLID + SPHERE + STENOSED.format("[20.0, 30.0]"), r"outside the block.*from -20 to 20"),
    (SOLID.replace("modulus", "z_mm = -20.0\nmodulus") + SPHERE, "must lie under the finger"),
    (
        SOLID.replace("modulus", "z_mm = 3.0\nmodulus").replace('"solid"', '"strain"')
        .replace("length_mm = 40.0\n", ""), 'z_mm = 3.0: only with plane = "solid"',
    ),
    ('name = "a"\nplane = "solid"\n', "needs a"),
    (SOLID + "[indenter]\nedge_radius_mm = 1.0\ntilt_deg = 5.0\n",
     "turns a cylinder along the vessels about itself"),
    (SOLID + '[indenter]\naxis = "across"\nedge_radius_mm = 1.0\ntilt_deg = 50.0\n', "tilt_deg"),
])  # fmt: skip
def test_what_cannot_be_is_refused_by_its_key(text: str, key: str) -> None:
    with pytest.raises(SceneError, match="(?s)" + key.replace("[", r"\[")):
        scene_from_text(text, "mine.toml")


def test_balls_may_lie_behind_each_other() -> None:
    def lump(z_mm: float) -> dict[str, Any]:
        return {"kind": "tumour", "x_mm": 32.0, "depth_mm": 8.0, "z_mm": z_mm, "diameter_mm": 4.0,
                "modulus_kpa": 500.0, "poisson": 0.49}  # fmt: skip

    table = load_scene("TI-solid").model_dump() | {"inclusion": [lump(-6.0), lump(6.0)]}
    assert len(Scene.model_validate(table).inclusion) == 2
    with pytest.raises(ValueError, match="overlaps"):
        Scene.model_validate(table | {"inclusion": [lump(-1.0), lump(2.0)]})


def test_a_row_beside_the_middle_sees_everything_moved() -> None:
    ring = {"fraction": 0.3, "modulus_kpa": 4000.0, "z_mm": (-2.0, 6.0)}
    vessel = {"kind": "artery", "x_mm": 20.0, "depth_mm": 10.0, "inner_diameter_mm": 4.0,
              "wall_mm": 1.0, "modulus_kpa": 400.0, "poisson": 0.45, "stenosis": ring}  # fmt: skip
    lump = {"kind": "tumour", "x_mm": 40.0, "depth_mm": 8.0, "diameter_mm": 4.0,
            "modulus_kpa": 500.0, "poisson": 0.49}  # fmt: skip
    scene = Scene.model_validate(
        load_scene("TI-solid").model_dump() | {"inclusion": [vessel, lump]}
    )
    assert section_at(scene, 0.0) is scene
    there = section_at(scene, 5.0)
    artery, ball = there.inclusion
    assert there.tissue is not None and there.tissue.z_mm == -5.0
    assert isinstance(artery, Artery) and artery.stenosis is not None
    assert artery.stenosis.z_mm == (-7.0, 1.0) and getattr(ball, "z_mm", None) == -5.0
    assert Scene.model_validate(there.model_dump()) == there
    back = section_at(there, -5.0)
    assert back.inclusion[0] == scene.inclusion[0] and back.tissue.z_mm == 0.0
    with pytest.raises(SceneError, match=r"z = -20 mm.*from -20 to 20 mm"):
        section_at(scene, -20.0)


def test_a_cut_under_the_finger_shows_what_is_there() -> None:
    vessel = STENOSED.format("[-3.0, 3.0]") + "path = [[-10.0, 28.0, 9.0], [10.0, 36.0, 7.0]]\n"
    ball = '[[inclusion]]\nkind = "tumour"\nx_mm = 50.0\ndepth_mm = 9.0\ndiameter_mm = 5.0\n'
    ball += "modulus_kpa = 200.0\npoisson = 0.45\n"
    scene = scene_from_text(SOLID + vessel + ball + "z_mm = 1.5\n" + SPHERE, "mine")
    artery, lump = under_finger(scene)
    assert (artery.x_mm, artery.depth_mm) == (32.0, 8.0)
    assert lump.outer_radius_mm == pytest.approx(2.0)
    (artery,) = under_finger(section_at(scene, 5.0))
    assert (artery.x_mm, artery.depth_mm) == (34.0, 7.5)
    plane = load_scene("TIT")
    assert under_finger(plane) is plane.inclusion


def test_plane_models_refuse_a_solid() -> None:
    solid = load_scene("TI-solid")
    with pytest.raises(SceneError, match="is a solid"):
        build_section(solid, 32e-3, depth_m=1e-3, size_m=1e-3)
    with pytest.raises(SceneError, match="plane = 'solid', is solved as axisymmetric or solid"):
        press(solid, 32.0, 1.0, model="finite")
    with pytest.raises(SceneError, match="plane = 'stress'"):
        press(load_scene("TI"), 32.0, 1.0, model="solid")


def test_a_finger_that_leans_leans_the_other_way_in_the_mirror() -> None:
    text = SOLID + '[indenter]\nshape = "flat"\ndiameter_mm = 8.0\nedge_radius_mm = 1.0\n'
    upright = scene_from_text(text, "a")
    leaning = scene_from_text(text + "tilt_deg = 5.0\n", "a")
    assert mirrored(upright) == upright
    assert mirrored(leaning).indenter.leaning_deg == -5.0
    assert mirrored(mirrored(leaning)) == leaning
    assert is_round(upright, 32e-3)
    assert not is_round(leaning, 32e-3), "it is no body of revolution"
    # the place of two that are each other's image, each with its finger's lean
    assert station(leaning, 20e-3, 1e-3) != station(leaning, 44e-3, 1e-3)
    assert station(leaning, 20e-3, 1e-3) == station(mirrored(leaning), 44e-3, 1e-3)
