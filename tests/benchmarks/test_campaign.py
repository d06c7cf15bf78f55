"""The fault campaign's own parts: a truth that is physics, and a judge that finds what is wrong."""

import math
import os
import signal
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from campaign import guard_fork, scanning, simulated
from campaign.arm import Tip
from campaign.board import ORIGIN_MM, Board
from campaign.cell import ZEROS_N, Cell
from campaign.faults import BY_NAME, KINDS, SIMULATED, Draw, draw, of_kinds
from campaign.host import Host
from campaign.judge import judge
from campaign.world import HARDENING_PER_M, PULSE_N, TAU_S, Bed, World

from probe.core.events import Finish
from sim_backend.emulators.ur.mounting import Mounting
from sim_backend.emulators.ur.robot import Robot

DEEP = (0.0, 0.0, -2e-3)


def world(bed: Bed | None = None, z_m: float = 5e-3) -> World:
    return World(bed or Bed(), 0.0, (0.0, 0.0, z_m))


def test_a_move_takes_the_time_of_its_trapezium() -> None:
    tip = world()
    tip.move((0.0, 0.0, -5e-3), 10e-3)
    while tip.moving:
        tip.advance(tip.time_s + 1e-3)
    assert tip.place == (0.0, 0.0, -5e-3)
    assert tip.time_s == pytest.approx(10e-3 / 10e-3 + 10e-3 / 1.0, abs=5e-3)


def test_a_halt_takes_the_way_of_its_deceleration() -> None:
    tip = world()
    tip.move((0.0, 0.0, -5e-3), 20e-3)
    tip.advance(0.1)
    before = tip.place[2]
    tip.halt()
    tip.advance(0.2)
    assert not tip.moving
    assert before - tip.place[2] == pytest.approx(20e-3**2 / 2, abs=25e-6)


def test_the_bed_hardens_and_relaxes() -> None:
    tip = world()
    tip.move(DEEP, 20e-3)
    tip.advance(2.0 + 20 * TAU_S)
    spring = Bed().stiffness_n_m * 2e-3 * (1 + HARDENING_PER_M * 2e-3)
    assert spring <= tip.force_n <= spring + PULSE_N + 1e-6
    assert max(row[4] for row in tip.rows) > spring + 0.1  # the arm that has relaxed since


def test_the_skin_sticks() -> None:
    tip = world(z_m=-1e-3)
    tip.advance(0.01)
    tip.move((2e-3, 0.0, -1e-3), 10e-3)
    tip.advance(1.0)
    assert tip.side_n == pytest.approx(Bed().shear_n_m * 2e-3, rel=0.01)


def test_the_board_speaks_grbl() -> None:
    board = Board(world())
    board.received(b"?$J=G21G90G53Z-57.0F600\n?")
    board.world.advance(0.1)
    assert board.due().startswith(b"<Idle|MPos:-80.000,-20.000,-47.000")
    board.received(b"?")
    board.world.advance(0.11)
    assert b"<Jog|" in board.due()
    board.received(b"\x85")
    board.world.advance(0.3)
    assert not board.world.moving
    assert board.stops == [pytest.approx(0.11)]
    board.received(b"$J=G21G90G53Z10F600\n")
    board.world.advance(0.31)
    assert board.due() == b"error:15\r\n"
    assert board.world.place[2] < 5e-3 == pytest.approx(-47e-3 - 1e-3 * ORIGIN_MM[2])


def test_the_arm_feels_the_world() -> None:
    tip = World(Bed(), time.monotonic(), DEEP)
    arm = Robot(cast(Any, Tip(tip, Board(tip))), Mounting(), 0.0, 0, 0.002)
    time.sleep(0.01)
    said = arm.outputs(4)
    assert said["actual_TCP_pose"][:3] == pytest.approx(DEEP)
    assert said["actual_TCP_force"][2] == pytest.approx(tip.rows[-1][4], abs=0.2)


@pytest.mark.parametrize("zero_n", ZEROS_N)
def test_the_cell_prints_what_it_feels(zero_n: float) -> None:
    tip = world(z_m=-2e-3)
    cell = Cell(tip, seed=1, zero_n=zero_n)
    said: list[float] = []
    for n in range(1, 201):
        tip.advance(5e-3 * n)
        said += [float(line.split()[1]) for line in cell.due().splitlines()]
    assert len(said) == pytest.approx(200, abs=1)
    assert np.mean(said[100:]) - zero_n == pytest.approx(tip.force_n, abs=10e-3)


def test_a_seed_is_a_run() -> None:
    assert repr(draw(17, 2)) == repr(draw(17, 2))  # a time that is not known is no number
    assert repr(draw(17, 2)) != repr(draw(17 + len(KINDS), 2))
    assert {draw(seed, 1).name for seed in range(len(KINDS))} == {kind.name for kind in KINDS}
    assert {draw(seed, 1).zero_n for seed in range(len(KINDS))} == set(ZEROS_N)


@pytest.mark.parametrize("kind", ["cell silent", "board slow", "hard bed", "higher bed"])
def test_a_fault_on_simulated_time_harms_nobody(kind: str) -> None:
    drawn = of_kinds(5, [BY_NAME[kind]], np.random.default_rng(5))
    assert simulated.run_draw(drawn)["wrong"] == []


def test_a_resume_while_the_disk_stands_still_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its own words, and nothing else, make a run void: another reason is a violation."""
    drawn = of_kinds(5, [BY_NAME["cell silent"]], np.random.default_rng(5))
    scan, verdicts = simulated._scan, []
    for reason in ("the disk has not taken anything for 2 s", "it has rained"):

        def ends(*asked: Any, reason: str = reason) -> Any:
            ended = scan(*asked)
            return replace(ended, finish=Finish.FAULTED, reason=reason) if asked[2] else ended

        monkeypatch.setattr(simulated, "_scan", ends)
        row = simulated.run_draw(drawn)
        verdicts.append((row["void"], row["wrong"]))
    assert verdicts == [(True, []), (False, ["not resumable: it has rained"])]


def hard(monkeypatch: pytest.MonkeyPatch, **limits: float) -> list[str]:
    """What is said of a scan of a hard bed whose limits were lifted."""
    monkeypatch.setattr(simulated, "LIMITS", replace(simulated.LIMITS, **limits))
    drawn = of_kinds(5, [BY_NAME["hard bed"]], np.random.default_rng(5))
    wrong: list[str] = simulated.run_draw(drawn)["wrong"]
    return wrong


def test_the_judge_finds_a_force_beyond_the_physics_of_stopping(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert "allowed" in hard(monkeypatch, max_force_n=50.0)[0]


def test_the_judge_finds_a_probe_left_in_the_tissue(monkeypatch: pytest.MonkeyPatch) -> None:
    move = simulated.BenchStage.move

    def sinks(self: simulated.BenchStage, target: simulated.Pose, speed_m_s: float) -> None:
        if target.z <= self.pose().z or self.pose().z > 0:  # out of the bed it never goes
            move(self, target, speed_m_s)

    monkeypatch.setattr(simulated.BenchStage, "move", sinks)
    said = " ".join(hard(monkeypatch))
    assert "left" in said


def test_the_judge_finds_samples_that_were_never_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    read = simulated.BenchSensor.read

    def doctored(self: simulated.BenchSensor) -> simulated.Block:
        block = read(self)
        return replace(block, values=1.001 * block.values)

    monkeypatch.setattr(simulated.BenchSensor, "read", doctored)
    drawn = Draw(1, (), Bed(), serial=False)
    assert any("never sent" in text for text in simulated.run_draw(drawn)["wrong"])


def test_the_judge_finds_a_station_that_was_somewhere_else(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong_place(self: simulated.BenchStage) -> simulated.Pose:
        self._answer()
        x, y, z = self._bench.world.place
        return simulated.Pose(x - 2e-3, y, z)

    def move(self: simulated.BenchStage, target: simulated.Pose, speed_m_s: float) -> None:
        self._answer()
        x, y, z = (1e3 * v for v in target[:3])
        self._bench.board.jog((x + 2.0, y, z), speed_m_s)

    monkeypatch.setattr(simulated.BenchStage, "pose", wrong_place)
    monkeypatch.setattr(simulated.BenchStage, "move", move)
    drawn = Draw(1, (), Bed(), serial=False)
    assert any("off its place" in text for text in simulated.run_draw(drawn)["wrong"])


@pytest.mark.parametrize("status, answer, said, found", [
    (None, None, "", "hangs"),
    (70, None, "This is a mistake in palpate itself", "a bug"),
    (0, {"finish": "faulted"}, "", "but faulted"),
    (137, None, "", "killed"),
    (3, None, "guard: the process that guards did not come up", "never began"),
])  # fmt: skip
def test_the_judge_reads_status_and_words(
    status: int | None, answer: dict[str, str] | None, said: str, found: str
) -> None:
    bench = simulated.Bench(Draw(1, (), Bed(), serial=False), simulated.SimulatedClock())
    bench.clock.sleep_until(0.1)
    bench.catch_up()
    verdict = judge(bench.drawn, bench.truth(), status=status, answer=answer, said=said, run=None)
    assert any(found in text for text in verdict.wrong)


def test_a_scan_of_the_campaign_hears_ctrl_c_as_a_program_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def main() -> int:
        print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)
        return 7

    monkeypatch.setattr("probe.cli.main", main)
    scan = scanning.start([], tmp_path, tmp_path / "answer")
    until_s = time.monotonic() + 20.0
    while (status := scan.status()) is None and time.monotonic() < until_s:
        time.sleep(0.01)
    assert status == 7
    assert (tmp_path / "answer").read_text() == "True\n"
    scan.close_terminal()


def test_guards_that_were_forked_beforehand_get_every_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrived = tmp_path / "lines"
    main = "probe.guards.guard_process.main"
    monkeypatch.setattr(main, lambda: arrived.write_text(" ".join(sys.argv)))
    prepared = guard_fork.Prepared()
    lines = [*os.pipe(), *os.pipe(), *os.pipe()]
    prepared([], pass_fds=lines)
    assert prepared.wait(20.0) == 0
    assert len(arrived.read_text().split()) == 1 + len(lines)
    for line in lines:
        os.close(line)
    prepared._ours.close()


def test_a_strike_that_finds_no_memory_is_no_mistake_of_the_scan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def start(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    heard, inside = os.pipe()
    os.write(inside, b"b")
    os.close(inside)
    scanning._strike_inside(heard)
    assert os.read(heard, 1) == b""  # it went on to the end
    os.close(heard)


@pytest.mark.parametrize("files, both", [
    (["out/a.run", "out/a.run.control", "second/b.run"], True),
    (["out/a.run", "out/a.run.control"], False),
    (["out/a.run", "second/b.run"], False),
])  # fmt: skip
def test_a_second_program_may_drive_once_the_run_has_ended(
    files: list[str], both: bool, tmp_path: Path
) -> None:
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    scan = scanning.Scan(0, 0, None, 0)
    assert Host(scan, tmp_path / "out", tmp_path / "rig.toml").both_drive is both


def test_every_simulated_kind_exists() -> None:
    assert all(math.isfinite(kind.blind_s) or kind.where == "cell" for kind in SIMULATED)
