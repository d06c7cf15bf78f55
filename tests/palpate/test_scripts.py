"""Scripts without an ``if __name__ == "__main__"`` guard: each runs once, from its first line.

A worker that ran the script again would say "begun" again, or start scans without end.
"""

from pathlib import Path

from grbl_ft300 import DEVICES
from programs import python

from drivers import WallClock
from sim_backend import load_scene
from sim_backend.emulators import ft300, grbl
from sim_backend.phantom.phantom import Phantom, Respond

BLOCK = """
name = "small block"
[tissue]
width_mm = 24.0
height_mm = 10.0
modulus_kpa = 50.0
poisson = 0.49
"""
PRESS = """
[scan]
start_mm = 9.0
stations = 2
indentation_mm = 2.0
ramp_s = 0.3
hold_s = 0.2
settle_s = 0.15
[safety]
retract_mm = 1.0
max_force_n = 20.0
silence_s = 5.0
late_s = 5.0
hardest_n_mm = 5.0
"""
CHILDREN = """
import sys
print("begun")
sys.addaudithook(lambda event, _: event == "subprocess.Popen" and print("child"))
import palpate
"""
SCAN = "print(palpate.scan('rig.toml').ended.reason)\n"
VIRTUAL = "print(palpate.scan('rig.toml', 'block.toml', real_time={}).ended.reason)\n"
SWEEP = """
table = palpate.sweep("block.toml", {"modulus_kpa": [40, 60]}, x_mm=[12.0], indentation_mm=0.5,
                      model="small", accuracy_pct=20.0, workers=2, out="sweep.csv")
print(len(table), set(table["reason"]))
"""


def run(folder: Path, script: str, rig: str) -> list[str]:
    """What the script printed, as a file of its own that somebody starts."""
    (folder / "rig.toml").write_text(rig + PRESS)
    (folder / "block.toml").write_text(BLOCK)
    (folder / "script.py").write_text(CHILDREN + script)
    done = python("script.py", cwd=folder, status=0)
    assert not done.stderr
    return done.stdout.splitlines()


def test_a_script_scans_an_emulated_rig(tmp_path: Path, winkler: Respond) -> None:
    world = Phantom(load_scene("TIHA"), WallClock(), winkler, home=(0.009, 0.0, 0.003))
    with (
        grbl.emulate(world, at=str(tmp_path / "grbl"), homed=True) as board,
        ft300.emulate(world, at=str(tmp_path / "ft300"), noise_n=0.01) as sensor,
    ):
        rig = DEVICES.format(board=board.address, sensor=sensor.address)
        said = run(tmp_path, SCAN, rig)
    assert said == ["begun", "child", "every station is complete"]  # the guards


def test_a_script_scans_a_virtual_rig_in_real_time(tmp_path: Path) -> None:
    said = run(tmp_path, VIRTUAL.format(True), "")
    assert said == ["begun", "child", "every station is complete"]  # the guards


def test_a_script_scans_with_workers_that_solve_ahead_and_sweeps(tmp_path: Path) -> None:
    said = run(tmp_path, VIRTUAL.format(False) + SWEEP, "")
    assert said == ["begun", "every station is complete", "2 {''}"]
