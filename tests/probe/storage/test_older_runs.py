"""Runs written before the layout changed open, verify, resume and detect as they did then."""

import json
import lzma
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paths import ROOT

from probe.cli.finding import finding_json
from probe.core.events import Finish
from probe.core.recording import Recording
from probe.scan.resume import resume, unfinished
from probe.storage.run import open_run
from probe.storage.verify import verify

RUNS = ROOT / "tests" / "data" / "runs"
EXPECTED: dict[str, Any] = json.loads((RUNS / "expected.json").read_text())


def unpacked(name: str, folder: Path) -> Path:
    """An older run, with the log of one that was killed."""
    for packed in RUNS.glob(f"{name}.run*.xz"):
        (folder / packed.stem).write_bytes(lzma.decompress(packed.read_bytes()))
    return folder / f"{name}.run"


def digest(recording: Recording) -> str:
    """SHA-256 over everything that detection is given."""
    total = sha256()
    for s in recording.stations:
        numbers = np.array([s.index, s.x_m, s.y_m, s.indent_s, s.hold_s, s.retract_s])
        parts = (s.time_s, s.signal_pa, s.saturated, s.depth_m, s.reference_s, s.reference, numbers)
        for part in parts:
            total.update(np.ascontiguousarray(part).tobytes())
    total.update(np.array([recording.face_m2, recording.quantum_pa]).tobytes())
    return total.hexdigest()


@pytest.mark.parametrize("name", EXPECTED)
def test_is_read_and_verified_as_before(name: str, tmp_path: Path) -> None:
    path, expected = unpacked(name, tmp_path), EXPECTED[name]
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert verify(path).as_json() == {"run": str(path), **expected["verify"]}
    assert digest(open_run(path).recording()) == expected["recording_sha256"]
    left = unfinished(path)
    assert (list(left.missing), left.start_s) == (expected["missing"], expected["start_s"])
    after = {name: (tmp_path / name).read_bytes() for name in before}
    assert after == before  # reading writes nothing


@pytest.mark.parametrize("name", EXPECTED)
def test_is_detected_on_as_before(name: str, tmp_path: Path) -> None:
    """What is given is the same to the digit (above); a later detector may say more or less."""
    path, expected = unpacked(name, tmp_path), EXPECTED[name]["detect"]
    found = json.loads(json.dumps(finding_json(path, open_run(path).recording(), 0.0)))
    for key in ("finish", "simulated"):
        assert found[key] == expected[key]
    assert found["finding"] in (expected["finding"], "undecided")
    for mine, then in zip(found["stations"], expected["stations"], strict=True):
        assert set(mine) >= set(then)
        assert mine["x_mm"] == pytest.approx(then["x_mm"], abs=1e-6)  # shown to the nanometre
        assert mine["baseline_pa"] == pytest.approx(then["baseline_pa"], rel=1e-3)
        sd_pa = max(mine["pulse_sd_pa"], then["pulse_sd_pa"])
        assert mine["pulse_pa"] == pytest.approx(then["pulse_pa"], abs=3 * sd_pa)


@pytest.mark.parametrize("name", ["aborted", "killed"])
def test_is_gone_on_with(name: str, tmp_path: Path, winkler: Any) -> None:
    path = unpacked(name, tmp_path)
    missing = EXPECTED[name]["missing"]
    whole = {s.index: s for s in open_run(path).recording().stations}
    assert resume(path, respond=winkler).ended.finish is Finish.COMPLETED
    report = verify(path)
    assert report.ok, report.problems
    assert report.stations_complete == 5
    now = {s.index: s for s in open_run(path).recording().stations}
    assert sorted(now) == sorted([*whole, *missing])
    for index, station in whole.items():
        np.testing.assert_array_equal(now[index].signal_pa, station.signal_pa)
        np.testing.assert_array_equal(now[index].depth_m, station.depth_m)
