"""The page about findings names every key that the commands print, and no other."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from known_presses import recording, row
from paths import ROOT

from probe.cli.finding import finding_json
from probe.detection import compare, detect


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
