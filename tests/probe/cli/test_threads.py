"""The command's solves run on one thread, unless its user says otherwise; a second process is begun
only for a scan that solves something."""

import os
from importlib import import_module

import pytest

from probe.cli import main
from probe.cli.command_line import ONE_THREAD


@pytest.mark.parametrize(("own", "then"), [(None, "1"), ("4", "4")])
def test_one_thread_unless_set(own: str | None, then: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ONE_THREAD:
        monkeypatch.setenv(name, own or "")
        if own is None:
            monkeypatch.delenv(name)
    assert main(["--version"]) == 0
    assert [os.environ[name] for name in ONE_THREAD] == [then, then]


@pytest.mark.parametrize(
    ("given", "begun"),
    [
        (("scan", "--scene", "nowhere.toml"), 1),
        (("scan", "--scene", "nowhere.toml", "--dry-run"), 0),
        (("scan", "--seed", "1", "--scene", "nowhere.toml"), 1),
        (("scan", "nowhere.toml"), 0),
        (("scan", "rig.toml", "--scene", "nowhere.toml"), 0),
        (("plan", "--scene", "nowhere.toml"), 0),
    ],
)
def test_what_a_scan_on_a_scene_needs_is_loaded_meanwhile(
    given: tuple[str, ...], begun: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[str] = []
    monkeypatch.setattr("sim_backend.models.second_process.start_early", loaded.append)
    assert main(given) == 2  # there is no such file
    assert len(loaded) == begun
    for module in loaded:
        import_module(module)
