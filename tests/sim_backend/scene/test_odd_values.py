"""A value in another unit than its key's is doubted; no scene that ships is."""

from importlib import resources

import pytest

import palpate
from sim_backend.scene.odd_values import odd_values
from sim_backend.scene.scene_file import scene_from_text, scene_names

TISA = (resources.files("sim_backend.scene") / "builtin" / "TISA.toml").read_text()


@pytest.mark.parametrize("name", scene_names())
def test_no_scene_that_ships_is_doubted(name: str) -> None:
    assert list(odd_values(palpate.load_scene(name))) == []


@pytest.mark.parametrize(
    ("line", "slipped", "said"),
    [
        ("width_mm = 64.0", "width_mm = 64000", "tissue.width_mm = 64000: 6,400 times more"),
        ("height_mm = 16.83", "height_mm = 16830", "tissue.height_mm = 16830: 1,683 times more"),
        ("modulus_kpa = 50.0", "modulus_kpa = 0.05", "tissue.modulus_kpa = 0.05: 2,000 times less"),
        ("modulus_kpa = 50.0", "modulus_kpa = 5e4", "tissue.modulus_kpa = 50000: 500 times more"),
        ("modulus_kpa = 400.0", "modulus_kpa = 0.4", "inclusion[0].modulus_kpa = 0.4: 250 times"),
        ("modulus_kpa = 4000.0", "modulus_kpa = 4", None),
        ("wall_mm = 0.63", "wall_mm = 0.06", "inclusion[0].wall_mm = 0.06: 167 times less"),
        ("radius_mm = 5.0", "radius_mm = 0.005", "indenter.radius_mm = 0.005: 2,000 times less"),
        ("length_mm = 10.0", "length_mm = 0.01", "indenter.length_mm = 0.01: 1,000 times less"),
        ("diastolic_mmhg = 80.0", "diastolic_mmhg = 0.08", "pulse.diastolic_mmhg = 0.08: 1,250"),
        ("depth_mm = 12.66", "depth_mm = 4.0", None),
    ],
)
def test_a_slip_of_the_unit_is_doubted_by_name(line: str, slipped: str, said: str | None) -> None:
    assert line in TISA
    doubts = list(odd_values(scene_from_text(TISA.replace(line, slipped, 1).encode(), "TISA")))
    if said is None:
        assert doubts == []
    else:
        (doubt,) = doubts
        assert doubt.startswith(said)
        assert doubt.endswith("is its unit right?")
