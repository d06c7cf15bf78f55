"""Every sentence of the safety case is listed, with the tests that fail when it is false."""

import re
from functools import cache
from pathlib import Path

import pytest
from paths import ROOT

from drivers.core import segments
from drivers.ur.settings import WATCHDOG_S
from probe.guards import levels, press_guard, retreat, safety_monitor, stuck_sensor
from probe.planning.limits import HARDEST_N_M, Limits
from probe.scan import lifting
from probe.storage import writer

PAGE = ROOT / "docs" / "explanation" / "safety.md"

LISTED = Path(__file__).with_name("safety_case.txt")
"""The beginning of each sentence in the page's order, and under it the tests that hold it."""


def listed() -> list[dict[str, list[str]]]:
    """Tests by the beginning of a sentence: of the table of hazards, and of the prose."""
    parts: list[dict[str, list[str]]] = []
    for line in LISTED.read_text("utf-8").splitlines():
        if line.startswith("#"):
            parts.append({})
        elif line.startswith(" "):
            parts[-1][list(parts[-1])[-1]].append(line.strip())
        else:
            parts[-1][line] = []
    return parts


def measures() -> list[str]:
    """Of the table of hazards, each after a semicolon."""
    rows = [row.strip("|").split("|") for row in PAGE.read_text("utf-8").splitlines()
            if row.count("|") == 5]  # fmt: skip
    cells = [cells[1].strip() for cells in rows[2:]]
    return [said for cell in cells for said in re.split(r";\s", cell)]


def sentences() -> list[str]:
    """Of the sections that say what the guards do, without tables and formulas."""
    page = PAGE.read_text("utf-8")
    body = page[page.index("## The stopping") : page.index("## What remains for the controller")]
    lines = [line for line in body.splitlines() if not line.startswith(("|", "#", "    ", "{{"))]
    return re.split(r"(?<=[.:])\s+(?=[A-Z`])", " ".join(" ".join(lines).split()))


@cache
def all_tests() -> str:
    """Of the whole project, and of this file's own."""
    return "\n".join(file.read_text("utf-8") for file in (ROOT / "tests").rglob("test_*.py"))


@pytest.mark.parametrize("part", [0, 1], ids=["table", "prose"])
def test_every_sentence_is_listed_with_its_tests(part: int) -> None:
    starts = list(listed()[part])
    for sentence in (measures, sentences)[part]():
        assert starts and sentence.startswith(starts[0]), f"not listed, or out of order: {sentence}"
        starts.pop(0)
    assert starts == []


@pytest.mark.parametrize(
    "name", sorted({t for part in listed() for ts in part.values() for t in ts})
)
def test_each_of_its_tests_is_there(name: str) -> None:
    assert f"def {name}(" in all_tests()


def test_its_numbers_are_the_codes() -> None:
    assert WATCHDOG_S == 0.35  # "within `watchdog_s`"
    assert press_guard.PERIODS == 5  # "five periods"
    assert press_guard.JUDGED_SHARE == 0.25  # "a quarter deeper"
    assert press_guard.FLAT == 0.1  # "less than a tenth"
    assert press_guard.MIN_LIMIT_SHARE == 0.1  # "Below a tenth of the limit"
    assert (press_guard.SOFT_SHARE, press_guard.SOFT_WAY_M) == (0.005, 0.5e-3)
    assert press_guard.FAINT_WAY_M == 1e-3  # "one millimetre"
    assert 2 * press_guard.NOISE_SIGMAS == 20  # "twenty standard deviations"
    assert press_guard.LAST_SHARE == 0.05  # "a twentieth of the travel"
    assert press_guard.POLLS == 2  # "two polls of the stage"
    assert press_guard.NOISE_SIGMAS == 10  # "ten times the noise"
    assert press_guard.LITTLE_SHARE == 1 / 50  # "a 50th of the limit"
    assert (levels.LEVEL_S, lifting.RELEASED_SHARE, press_guard.WAY_M) == (0.1, 0.03, 50e-6)
    assert (levels.UNSTEADY, levels.MAX_UNSTEADY_S) == (4.0, 2.0)
    assert (stuck_sensor.MIN_RUN, Limits.same_readings) == (20, 100)
    assert (retreat.LIFTS, retreat.PATIENCE_S) == (3, 10.0)
    assert safety_monitor.SUPERVISOR_PERIOD_S == 0.01  # "every 10 ms"
    assert segments.AHEAD_S == 0.15  # "0.15 s"
    assert writer.LATE_S == 2.0  # "a disk that takes longer than 2 s"
    assert HARDEST_N_M == 10e3  # "10 N/mm (the default)"


def test_the_tables_are_the_formulas() -> None:
    page = PAGE.read_text("utf-8")
    rows = re.findall(r"\| (?:GRBL|UR)[^|]*\| (.*) \|$", page, re.MULTILINE)
    assert len(rows) == 2
    for row in rows:
        rate_hz, a_m_s2, way_mm, soft_n, hard_n = (
            float(cell.split()[0]) for cell in row.split("|")
        )
        v_mm_s = 6.25
        expected_mm = v_mm_s * (2 / rate_hz + 0.020) + v_mm_s**2 / (2e3 * a_m_s2)
        assert way_mm == pytest.approx(expected_mm, abs=0.006)
        assert soft_n == pytest.approx(0.6 * expected_mm, abs=0.006)
        assert hard_n == pytest.approx(10 * expected_mm, abs=0.06)
    fastest_mm_s = 5.0 / (1e-3 * HARDEST_N_M * press_guard.PERIODS / 100)
    assert f"at up to {fastest_mm_s:g} mm/s" in " ".join(page.split())
    burst_n = 1e-3 * HARDEST_N_M * fastest_mm_s * (press_guard.PERIODS / 100 + 0.01)
    assert f"adds up to {burst_n:g} N" in " ".join(page.split())
