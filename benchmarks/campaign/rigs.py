"""The rig files of the campaign's two rigs: a GRBL board with a load cell, a UR arm."""

from campaign.board import ORIGIN_MM
from campaign.cell import FULL_SCALE_N, RATE_HZ
from campaign.limits import (
    HARDEST_N_M,
    HOLD_S,
    INDENTATION_M,
    MAX_DEPTH_M,
    MAX_FORCE_N,
    PITCH_M,
    RAMP_S,
    RETRACT_M,
    START_M,
    STATIONS,
)

GRBL = """
face_mm2 = 100.0
[stage]
driver = "grbl"
port = "{board}"
origin_mm = [{origin}]
limits_mm = [[-5, 70], [-5, 5], [-4, 50]]
max_speed_mm_s = 25.0
status_hz = 100.0
[[sensor]]
driver = "lines"
port = "{cell}"
baud = 115200
pattern = "(?P<time>[0-9]+) (?P<force>[-+0-9.eE]+) N"
time_unit_s = 0.001
rate_hz = {rate_hz}
[[sensor.channel]]
name = "force"
unit = "N"
role = "force"
full_scale = {full_scale}
"""
UR = """
face_mm2 = 100.0
[stage]
driver = "ur"
host = "{host}"
[[sensor]]
driver = "ur"
host = "{host}"
"""
SCAN = f"""
[scan]
start_mm = {1e3 * START_M}
pitch_mm = {1e3 * PITCH_M}
stations = {STATIONS}
indentation_mm = {1e3 * INDENTATION_M}
ramp_s = {RAMP_S}
hold_s = {HOLD_S}
settle_s = 0.15
[safety]
max_force_n = {MAX_FORCE_N}
hardest_n_mm = {1e-3 * HARDEST_N_M}
max_depth_mm = {1e3 * MAX_DEPTH_M}
retract_mm = {1e3 * RETRACT_M}
silence_s = 0.25
"""


def grbl_rig(board: str, cell: str) -> str:
    """The board and the cell at their ports."""
    origin = ", ".join(map(str, ORIGIN_MM))
    devices = GRBL.format(
        board=board, cell=cell, origin=origin, rate_hz=RATE_HZ, full_scale=FULL_SCALE_N
    )
    return devices + SCAN


def ur_rig(host: str) -> str:
    """The arm at its address."""
    return UR.format(host=host) + SCAN
