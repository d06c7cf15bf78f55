"""`press` and `sweep`: what they say of how good their answers are, and what they refuse."""

from pathlib import Path
from typing import Any

import pytest
from own_scene import OWN_SCENE

from probe.cli.press import describe_press
from sim_backend.models.press import press
from sim_backend.scene.numbers import numbers
from sim_backend.scene.scene_file import SceneError, load_scene


def test_a_sweep_says_how_many_rows_miss_the_accuracy_and_what_to_do(
    palpate: Any, tmp_path: Path
) -> None:
    asked = ("sweep", "TIHA", "--vary", "wall_mm=0.5", "--depth", "0.5", "--accuracy", "5",
             "--workers", "1", "--json", "--out")  # fmt: skip
    small = palpate(*asked, tmp_path / "small.csv", "--model", "small", status=0)
    assert small.json["too_rough"] == 1
    assert small.json["largest_error_estimate_pct"] > 5
    assert "1 of 1 rows miss the accuracy of 5 % that was asked for" in small.err
    assert "leave --model out" in small.err
    chosen = palpate(*asked, tmp_path / "chosen.csv")
    assert chosen.json["too_rough"] == 0
    assert chosen.json["largest_error_estimate_pct"] <= 5
    assert "miss" not in chosen.err


def test_a_press_says_that_it_misses_the_accuracy(palpate: Any) -> None:
    asked = ("press", "TIHA", "--x", "32", "--depth", "0.5", "--accuracy", "5")
    small = palpate(*asked, "--model", "small")
    assert "the pulse's error of " in small.err
    assert "% misses the accuracy of 5 % that was asked for: leave --model out" in small.err
    least = palpate("press", "TI", "--x", "32", "--depth", "0.5", "--accuracy", "0.011", "--model",
                    "auto")  # fmt: skip
    assert "the force's error of " in least.err
    assert "asked for: no finer mesh was tried" in least.err
    assert "misses" not in palpate(*asked).err


def test_a_pulse_says_that_the_force_falls_while_the_pressure_rises() -> None:
    def said(*forces_n: float) -> str:
        state = {"force_n_per_mm": None, "contact_stress_pa": 1.0, "von_mises_pa": 1.0,
                 "contact_mm": [1.0, 2.0], "contact_error_mm": 0.1}  # fmt: skip
        states = [state | {"pressure_mmhg": mmhg, "force_n": force_n}
                  for mmhg, force_n in zip((120.0, 80.0), forces_n, strict=True)]  # fmt: skip
        found = {"scene": "x", "x_mm": 1.0, "depth_mm": 1.0, "model": "solid", "element": "wedge",
                 "dofs": 1, "seconds": 1.0, "force_error_estimate_pct": 1.0, "why": "",
                 "pulse_n": abs(forces_n[0] - forces_n[1]), "pulse_pa": 8.5,
                 "pulse_error_estimate_pct": 2.0, "states": states}  # fmt: skip
        return describe_press(found)[-1]

    rises, falls = said(0.2611, 0.2602), said(0.2602, 0.2611)
    assert "pulse, trough to crest: 0.0009 N" in rises
    assert "pulse, trough to crest: 0.0009 N" in falls
    assert "falls" not in rises
    assert "the force falls while the pressure rises" in falls


def test_a_scene_whose_wave_cannot_be_read_is_refused_as_by_a_scan(
    palpate: Any, tmp_path: Path
) -> None:
    scene = tmp_path / "mine.toml"
    scene.write_text(f'{OWN_SCENE}[pulse]\nwave = "nosuch.csv"\n')
    scanned = palpate("scan", "--scene", scene, "--out", tmp_path)
    pressed = palpate("press", scene, "--x", "12", "--depth", "0.5")
    assert (scanned.status, pressed.status) == (2, 2)
    assert pressed.err == scanned.err
    assert "not 'paper', 'brachial' or a CSV file" in pressed.err
    with pytest.raises(SceneError, match="not 'paper', 'brachial' or a CSV file"):
        press(scene, 12.0, 0.5)


def test_a_press_says_what_may_be_in_another_unit(palpate: Any, tmp_path: Path) -> None:
    scene = tmp_path / "mine.toml"
    scene.write_text(OWN_SCENE.replace("modulus_kpa = 50.0", "modulus_kpa = 0.05"))
    pressed = palpate("press", scene, "--x", "12", "--depth", "0.5", "--accuracy", "10")
    assert "warning: tissue.modulus_kpa = 0.05" in pressed.err
    assert "is its unit right?" in pressed.err


def test_a_gradient_obeys_the_laws_of_scale(palpate: Any) -> None:
    """Force goes with moduli and pressure together, and with the square of all lengths."""
    asked = ("press", "TISA", "--x", "30", "--depth", "1.5", "--accuracy", "5", "--gradient")
    outcome = palpate(*asked, "--json")
    scene = load_scene("TISA")
    values = {**numbers(scene), "x_mm": 30.0, "depth_mm": 1.5}
    states = outcome.json["states"]
    for state in states:
        values["pressure_mmhg"] = state["pressure_mmhg"]
        by = state["gradient"]
        assert set(by) == set(values)
        change = {key: values[key] * by[key] for key in by}
        elastic = sum(one for key, one in change.items() if key.endswith(("_kpa", "_mmhg")))
        lengths = sum(one for key, one in change.items() if key.endswith("_mm"))
        assert elastic == pytest.approx(state["force_n"], rel=1e-6)
        assert lengths == pytest.approx(2 * state["force_n"], rel=1e-5)
    pulse = outcome.json["pulse_gradient"]["inclusion.0.wall_mm"]
    low, high = sorted(states, key=lambda one: one["force_n"])
    wall = "inclusion.0.wall_mm"
    assert pulse == pytest.approx(high["gradient"][wall] - low["gradient"][wall])
    said = palpate(*asked).out
    assert f"{1e3 * pulse:.4g}" in next(line for line in said.splitlines() if wall in line)


def test_without_being_asked_a_press_says_no_gradient(palpate: Any) -> None:
    found = palpate("press", "TI", "--x", "32", "--depth", "0.1", "--accuracy", "5", "--json").json
    assert "pulse_gradient" not in found
    assert "gradient" not in found["states"][0]


def test_a_press_spreads_its_force_over_taxels(palpate: Any) -> None:
    asked = ("press", "TI", "--x", "32", "--depth", "1", "--accuracy", "5", "--taxels", "2x6")
    (state,) = palpate(*asked, "--json").json["states"]
    assert [len(row) for row in state["taxels_n"]] == [6, 6]
    assert sum(map(sum, state["taxels_n"])) == pytest.approx(state["force_n"], rel=1e-9)
    lines = palpate(*asked, "--pitch", "1").out.splitlines()
    first = next(n for n, line in enumerate(lines) if "taxels at 0 mmHg [mN]" in line)
    assert "mN beside them" in lines[first], "two rows of 1 mm of a finger of 10 mm"
    assert len(lines[first + 1].split()) == 6


def test_taxels_finer_than_a_solid_s_elements_are_refused_before_it_is_solved(
    palpate: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim_backend.models.table.refine", None)
    outcome = palpate("press", "TIHA-solid", "--x", "32", "--depth", "1", "--taxels", "8x8")
    assert (outcome.status, "take a pitch of" in outcome.err) == (2, True)
