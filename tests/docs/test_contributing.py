"""CONTRIBUTING's questions and the pages of files and findings lead to what is there."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_presses import recording, row
from paths import ROOT
from programs import python

from probe.cli.finding import finding_json
from probe.detection import compare, detect

ROWS = re.findall(r"^\| (.+\?) \| (.+) \|$", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), re.M)
PACKAGES = ("palpate", "probe", "sim_backend", "drivers", "calibration")
DEFINED = {
    "force limit": "the limit is",
    "lift after a stop": "def lift_speed_m_s",
    "protective stop": "def why_stopped",
    "newtons into pascals": "class StressConversion",
    "direction does a press": "def normal_of",
    "is silent": "class Silence",
    "says the same for ever": "def _longest",
    "heart rates": "SLOWEST_HZ, FASTEST_HZ =",
    "tissue relax": "def _relaxed_away",
    "confidence intervals": "def correlated",
    "as a press must": "def _too_flat",
    "simulated force made in the air": "def in_the_air",
    "lacks samples": "TAIL_S",
    "hold begin": "def hold_limits",
    "slides aside": "def reach_inwards_m",
    "space bar": "class SpaceBar",
    "quotation marks": "def _mistaken",
    "the press?": "def pressed_n",
    "vessel's wall": "def layers",
    "under the finger": "FIRST_SHARE",
    "simulated noise": "class VirtualSensor",
    "simulated taxel": "class Taxels",
    "planner have to do": "class Planner(Protocol)",
    "coarse-to-fine press": "def levels(",
    "decide press next": "def _most_telling(",
    "row over a known block": "def weighed(",
    "planner that fails": "def _guarded(",
    "hold has a pulse": "def which_pulse",
    "breathing and no pulse": "def is_no_pulse",
    "beside a movement": "def calm_half(",
    "drift through a sensor": "def unrounded(",
    "presses over nothing": "def unlike_empty",
    "priors of what lies beneath": "class Priors(",
    "narrowing from a stiff wall": "class TwoRows",
    "tumour or artery": "def judge",
    "run file's layout": "CREATE TABLE",
    "finger and tissue": "def finger_pairs",
    "solves equilibrium": "def equilibrium(",
    "eliminates the unknowns": "int factor_fronts(",
    "for FEBio": "def write_feb(",
    "material law": "def plane_stress",
    "rig file": "class Scan(",
    "every driver": "class Sensor(Protocol)",
    "add a unit": "SI = {",
    "registers into numbers": "convert_from_registers",
    "clock to the scan": "class DeviceTime",
    "uploaded again": "def program_ended_by_us",
    "tare subtracted": "raw - self._zero",
    "as zero before a press": "def take_zero(",
    "course over a grid": "def across_rows(",
    "too old": "valid_days",
    "fail on command": "LINE_FAULTS",
    "dead taxel": 'role="other"',
    "called saturated": "saturated = np.abs(raw) >= self._full_scale",
    "check sum": "def sha256(",
    "false alarm": "DEFAULT_FALSE_ALARM = ",
    "cut from the stream": "def record(",
    "ECG or PPG": "def beats_s",
}


def test_each_question_is_answered() -> None:
    assert len(ROWS) == len(DEFINED)
    for about in DEFINED:
        assert sum(about in question for question, _ in ROWS) == 1, about


@pytest.mark.parametrize(("question", "answer"), ROWS, ids=[question for question, _ in ROWS])
def test_the_answer_holds_what_is_asked_for(question: str, answer: str) -> None:
    files = re.findall(r"`([^`]+)`", answer)
    assert files
    for file in files:
        assert (ROOT / file).is_file(), file
    about = next(about for about in DEFINED if about in question)
    assert DEFINED[about] in (ROOT / files[0]).read_text(encoding="utf-8")


def test_every_room_is_named() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for package in ("probe", "sim_backend"):
        said = re.search(rf"^\| `{package}`.*?\| (.+) \|$", text, re.M)
        named = set(re.findall(r"`(\w+)`", said.group(1)))
        there = {path.parent.name for path in (ROOT / package).glob("*/__init__.py")}
        assert named == there


def test_the_page_is_that_of_the_files() -> None:
    page = ROOT / "docs" / "reference" / "files.md"
    printed = python(ROOT / "docs" / "files.py", "--print", encoding="utf-8", status=0).stdout
    assert page.read_text(encoding="utf-8") == printed, "run: python docs/files.py"


def named(table: str) -> set[str]:
    """Keys in the first column of a table of the page."""
    return {
        key for line in table.splitlines() for key in re.findall(r"`(\w+)`", line.split(" | ")[0])
    }


def test_every_key_is_explained() -> None:
    scan = recording(row(np.random.default_rng(2), bump=0.15, pulse_pa=400.0))
    page = (ROOT / "docs" / "reference" / "findings.md").read_text()
    whole, objects, stations, compared = re.findall(r"(?:^\|.*\n)+", page, re.MULTILINE)
    found = detect(scan)
    vessel = replace(found.objects[0], course=((0.0, 0.0),), stenosed_m=(0.0, 0.0))
    printed = replace(found, objects=(vessel,)).as_json()
    assert named(whole) == set(finding_json(Path("a.run"), scan, 0.0))
    assert named(objects) == set(printed["objects"][0])
    assert named(stations) == set(printed["stations"][0])
    assert named(compared) == set(compare(scan, scan).as_json()) | {"simulated"}
