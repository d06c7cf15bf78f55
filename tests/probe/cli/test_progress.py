"""What a command says while it takes long."""

import io
import sys
import time

import pytest

from palpate import press
from probe.cli.progress import counting, solving


def test_who_waits_sees_what_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is said while capsys empties its buffer would be lost."""
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    with solving(after_s=0.3) as show:
        show("the first mesh")
        show("the second mesh")
        assert not said.getvalue()
        end_s = time.monotonic() + 10
        while not said.getvalue().endswith("\n"):
            assert time.monotonic() < end_s
            time.sleep(0.01)
        show("the third mesh")
    assert said.getvalue() == "solving the second mesh\nsolving the third mesh\n"


def test_a_short_wait_is_silent(capsys: pytest.CaptureFixture[str]) -> None:
    with solving(after_s=0.05) as show:
        show("the first mesh")
    time.sleep(0.1)
    assert not capsys.readouterr().err


def test_a_press_says_model_and_mesh() -> None:
    heard: list[str] = []
    press("TI", 32.0, 1.0, accuracy_pct=0.1, solving=heard.append)
    for words in ("finite strain on elements of 0.25 mm", "so far the force is within"):
        assert any(words in one for one in heard), heard


def test_a_long_press_says_so_on_standard_error(palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("probe.cli.progress.PATIENCE_S", 0.0)
    outcome = palpate("press", "TI", "--x", "32", "--depth", "1", "--json")
    assert outcome.json["model"]
    assert "solving" in outcome.err


def test_a_log_has_lines_of_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only a terminal had any: an hour's sweep into a file said nothing."""
    now_s = 0.0
    monkeypatch.setattr("probe.cli.progress.monotonic", lambda: now_s)
    with counting("points") as progress:
        progress(2, 12)  # done before
        for done in range(3, 13):
            now_s += 4.0
            progress(done, 12)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "3 of 12 points, about 36 s left"
    assert 3 <= len(lines) <= 5
    with counting("points") as progress:
        progress(0, 2)
        now_s += 0.5
        progress(2, 2)
    assert not capsys.readouterr().err
