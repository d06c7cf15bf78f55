"""``palpate doctor``: what it says of devices, and that it asks them."""

from pathlib import Path

import pytest

from drivers import WallClock
from sim_backend.emulators import grbl
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import load_scene

pytestmark = pytest.mark.usefixtures("springs")


def test_doctor(palpate) -> None:
    outcome = palpate("doctor", "rigs/virtual.toml", "--json", status=0)
    force = outcome.json["noise"][0]
    assert force["unit"] == "N"
    assert force["std"] == pytest.approx(0.5e-3, rel=0.1)
    assert force["step"] == pytest.approx(0.1e-3)
    assert force["simulated"] is True


def test_doctor_says_of_a_locked_board_what_to_do(palpate, tmp_path: Path, winkler) -> None:
    world = Phantom(load_scene("TIHA"), WallClock(), winkler)
    rig = tmp_path / "rig.toml"
    with grbl.emulate(world, at=str(tmp_path / "board")) as board:
        rig.write_text(f'[stage]\ndriver = "grbl"\nport = "{board.address}"\n')
        outcome = palpate("doctor", rig, "--scene", "TIHA", "--json", status=3)
    (board_said,) = (one for one in outcome.json["checks"] if one["name"] == "grbl")
    assert board_said["level"] == "fault"
    assert "home = true" in board_said["text"]


def test_doctor_asks_devices_although_the_plan_cannot_be(palpate, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(
        '[stage]\ndriver = "grbl"\nport = "/dev/ttyNone"\n[safety]\nhardest_n_mm = 1000.0\n'
        '[[sensor]]\ndriver = "ft300"\nport = "/dev/ttyNone"\nname = "ft"\n'
    )
    outcome = palpate("doctor", rig, "--scene", "TIHA", "--json", status=3)
    said = {one["name"]: one["text"] for one in outcome.json["checks"]}
    assert "mm/s is allowed" in said["devices together"]
    assert "no such port" in said["grbl"]
    assert "also ft: port = '/dev/ttyNone': no such port" in said["grbl"]
