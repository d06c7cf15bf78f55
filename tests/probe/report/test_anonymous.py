"""What an anonymous run does not tell."""

from probe.core.events import RunStarted
from probe.report.anonymous import anonymous
from sim_backend import Scene, load_scene


def test_an_anonymous_run_names_nobody() -> None:
    config = {
        "labels": {"operator": "Ann", "specimen": "Bob"},
        "rig": {"stage": {"driver": "ur", "host": "10.1.2.3"}, "sensor": [{"port": "/dev/x"}]},
        "calibration": {"force": {"file": "/home/ann/f.json", "sha256": "0"}},
    }
    kept = anonymous(RunStarted(0.0, "2026-01-01T00:00:00+00:00", config, {}))
    for telling in ("Ann", "Bob", "10.1.2.3", "/dev/x", "/home", "2026"):
        assert telling not in str(kept)
    assert kept.config["rig"]["stage"]["driver"] == "ur"


def test_an_anonymous_run_names_no_file_of_its_user() -> None:
    """A home folder has a name, and so may a scene, a wave, a calibration and a computer."""
    home = "/home/ann/bob.toml"
    config = {
        "rig": {
            "stage": {"driver": "own", "program": "C:\\Users\\ann\\move.script"},
            "sensor": [{"driver": "own", "models": [home]}],
            "scene": {"name": "bob.toml", "surface_mm": 1.0},
            "calibration": {"force": "bob.json"},
        },
        "scene": load_scene("TIHA").model_dump(mode="json"),
        "computer": "0123abcd",
    }
    config["scene"]["pulse"]["wave"] = "bob.csv"
    kept = anonymous(RunStarted(0.0, "2026-01-01T00:00:00+00:00", config, {})).config
    for telling in ("ann", "bob", "0123abcd"):
        assert telling not in str(kept)
    assert kept["rig"]["scene"]["surface_mm"] == 1.0
    assert Scene.model_validate(kept["scene"]).name == "TIHA"  # what the section is drawn from
    built_in = {"rig": {"scene": {"name": "TIHA"}}}
    assert anonymous(RunStarted(0.0, "", built_in, {})).config == built_in
