"""The force limit holds something on every rig, whatever kind of sensor it has."""

import sys
from threading import Event, Thread
from typing import Any, cast

import numpy as np
import pytest
from springs import HARD_N_M, LIMIT_N, SpringSensor, on_springs, run_springs, spring_rig

from drivers import Block, Channel, ConfigError, Pose
from drivers.core.arrays import Array
from probe.config.devices import Devices
from probe.config.rig import Rig, RigError
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.guards.force_limit import SensorGuard
from probe.guards.prepare import Prepared, prepare
from probe.guards.press_guard import ForceReading, PressGuard, check_blind
from probe.guards.stuck_sensor import Alive
from probe.planning.limits import Limits
from sim_backend.scene.scene_file import Scene, load_scene

FT = tuple(
    Channel(name, unit, role)
    for name, unit, role in (("force", "N", "force"), ("fx", "N", "other"), ("fy", "N", "other"),
                             ("fz", "N", "other"), ("mx", "Nm", "other"))
)  # fmt: skip
LIMITS = Limits(1.0, 3e-3, ((-1.0, 1.0),) * 3, 25e-3)


@pytest.mark.parametrize("role", ["taxel", "pressure", "reference"])
def test_a_rig_whose_limit_holds_nothing_does_not_move(role: str) -> None:
    bed, stage, _ = on_springs(stiffness_n_m=HARD_N_M)
    ran = run_springs(bed, stage, [SpringSensor(bed, "skin", role, "Pa")])
    assert isinstance(ran.raised, ConfigError)
    assert "max_force_n would hold nothing" in str(ran.raised)
    assert stage.orders == []


@pytest.mark.parametrize(
    ("role", "reads"), [("taxel", "a pressure"), ("pressure", "a pressure"), ("force", "a force")]
)
def test_a_rig_without_a_face_is_refused(role: str, reads: str) -> None:
    bed, stage, _ = on_springs()
    devices = Devices(stage, (SpringSensor(bed, "skin", role, "Pa"),), None, ())
    with pytest.raises(RigError, match=f"face_mm2 is missing: sensor 'skin' reads {reads}"):
        ready_for(spring_rig(), None, devices)


def test_the_face_of_the_scene_makes_a_limit_of_pressures() -> None:
    bed, stage, _ = on_springs()
    devices = Devices(stage, (SpringSensor(bed, "skin", "taxel", "Pa"),), None, ())
    scene = load_scene("TI")
    limits = ready_for(spring_rig(), scene, devices).limits
    assert limits.face_m2 == pytest.approx(1e-6 * scene.face_mm2)


def test_a_press_too_fast_for_its_sensor_is_refused() -> None:
    """Five readings at 20 Hz take 0.25 s: at 2.5 mm/s on 10 N/mm that is 6.25 N, unseen."""
    bed, stage, _ = on_springs()
    sensor = SpringSensor(bed)
    sensor.rate_hz = 20.0
    rig = spring_rig(safety={"max_force_n": 5.0, "hardest_n_mm": 10.0}, scan={"approach_mm_s": 1.0})
    beat = SpringSensor(bed, "ppg", "reference", "V")  # 500 Hz, and feels nothing
    sensors = (sensor, beat)
    rig, devices = rig.model_copy(update={"face_mm2": 100.0}), Devices(stage, sensors, None, ())
    with pytest.raises(ConfigError, match=r"ramp_s = 2\.5 mm/s: on something .* at most 2 mm/s"):
        ready_for(rig, None, devices)
    slower = rig.scan.model_copy(update={"ramp_s": 1.3})
    ready_for(rig.model_copy(update={"scan": slower}), None, devices)


def ready_for(rig: Rig, scene: Scene | None, devices: Devices) -> Prepared:
    plan = plan_for(rig)
    return prepare(rig, plan, limits_for(rig, plan), scene, devices, 0)


def block(values: Any, saturated: Any = False) -> Block:
    values = np.atleast_2d(np.asarray(values, float))
    return Block(np.arange(1.0, 1.0 + len(values)), values, np.full(values.shape, saturated))


@pytest.mark.parametrize("row, said", [
    ([0.6, 0.0, 0.0, 0.6, 0.0], None),
    ([0.6, 0.7, 0.6, 0.6, 0.0], "force in all directions 1.100 N; the limit is 1 N"),
    ([0.0, 150.0, 0.0, 0.0, 0.0], "force in all directions 150.000 N"),
    ([0.0, float("nan"), 0.0, 0.0, 0.0], "force in all directions nan N"),
    ([0.6, 0.0, 0.0, 0.6, 0.4], "torque 0.400 Nm; the limit is 0.3 Nm"),
])  # fmt: skip
def test_sideways_force_and_torque_are_limited(row: list[float], said: str | None) -> None:
    guard = SensorGuard(FT, LIMITS)
    guard.tare()
    why = guard.check(block(row))
    assert why is None if said is None else why is not None and said in why


def test_a_payload_is_not_taken_for_a_sideways_force_before_the_first_tare() -> None:
    guard = SensorGuard(FT, LIMITS)
    assert guard.check(block([0.0, 8.0, 0.0, 0.0, 0.0])) is None


def test_a_saturated_pressure_is_noticed_without_a_face() -> None:
    guard = SensorGuard((Channel("p", "Pa", "pressure"),), LIMITS)
    why = guard.check(block([1e4], saturated=True))
    assert why is not None
    assert "saturated" in why


def test_a_sideways_force_ends_the_scan_and_lifts() -> None:
    bed, stage, _ = on_springs()

    class SixAxis(SpringSensor):
        channels = FT

        def block(self, time_s: Any, force: Any) -> Block:
            pushed = self.bed.tip.point(self.bed.clock.now())[2] < -1e-3
            one = [[f, 3.0 * pushed, 0.0, f, 0.0] for f in force]
            return block_at(time_s, one)

    sensor = SixAxis(bed)
    sensor.channels = FT
    ran = run_springs(bed, stage, [sensor])
    assert "force in all directions" in ran.reason
    assert f"limit is {LIMIT_N:g} N" in ran.reason
    assert ran.lifted


def block_at(time_s: Any, rows: Any) -> Block:
    values = np.asarray(rows, float).reshape(len(time_s), len(FT))
    return Block(time_s, values, np.zeros(values.shape, bool))


def test_the_time_without_a_reading_is_that_of_the_force_still_allowed() -> None:
    """At 1 mm/s on 10 N/mm the last 0.2 N take 20 ms; the whole newton took 100 ms."""
    limits = Limits(1.0, 3e-3, ((-1.0, 1.0),) * 3, 25e-3, hardest_n_m=10e3)
    for force_n, blind in ((0.0, False), (0.8, True), (-0.8, True), (2.0, True)):
        said = check_blind(limits, 1e-3, [ForceReading("cell", 0.05, force_n, 500.0)])
        assert (said is not None) == blind


def test_a_sensor_that_is_stuck_within_one_block_is_found_out_by_it() -> None:
    assert Alive(100).check(100 * [[0.3]]) is None
    assert Alive(100).check(101 * [[0.3]]) is not None


def test_how_long_readings_may_be_the_same_is_learned_from_how_often_they_are() -> None:
    """Of 202 pairs 100 were equal. The nth of more is by a chance of (100 + n) / (203 + n), so that
    36 have together one of more than 1e-9, and 37 of less."""
    alive = Alive(Limits.same_readings)
    assert alive.check([[0.01 * (n // 2)] for n in range(201)]) is None
    assert alive.check(37 * [[9.0]]) is None
    assert alive.check([[9.0]]) is not None


def test_who_says_that_a_sensor_is_coarse_is_believed_after_it_has_felt_a_press_too() -> None:
    """At rest in steps of 10 mN it says the same for ever; in the press it changed fifty times."""
    air, pressing, hold = 90 * [[0.0]], [[0.01 * n] for n in range(50)], 500 * [[0.5]]
    usual, said = Alive(Limits.same_readings), Alive(10_000)
    assert usual.check(air + pressing) is None
    assert usual.check(hold) is not None
    assert said.check(air + pressing + hold) is None


def test_the_greatest_force_is_that_of_as_many_readings_as_a_touch_needs() -> None:
    guard = SensorGuard((Channel("force", "N", "force"),), LIMITS)
    force = np.array([0.0, 0.9, 0.0, 0.3, 0.4, 0.5, 0.0])
    block = Block(np.arange(7) / 100, force[:, None], np.zeros((7, 1), bool))
    assert guard.check(block) is None
    assert guard.greatest_n(-1.0, 1) == 0.9
    assert guard.greatest_n(-1.0, 3) == pytest.approx(0.4)
    assert guard.greatest_n(0.025, 1) == 0.5
    assert guard.greatest_n(-1.0, 8) == 0.0, "so many were not read"


class Felt:
    """What a `PressGuard` asks of a sensor."""

    smooth_n = 0.0
    noise = 1e-3

    def noise_n(self, from_s: float) -> float:
        return self.noise if from_s < np.inf else np.inf  # of what is yet to come: none

    def newest_s(self) -> float:
        return 0.0


def test_a_tare_is_not_taken_for_noise() -> None:
    """The sensor's zero jumps by 0.5 N, and its noise is 0.2 mN."""
    guard = SensorGuard((Channel("force", "N", "force"),), LIMITS)
    force = 0.2e-3 * np.random.default_rng(1).standard_normal(80)
    force[:60] += 0.5

    def read(some: slice) -> None:
        block = Block(np.arange(80)[some] / 50, force[some, None], np.zeros((80, 1), bool)[some])
        assert guard.check(block) is None

    read(slice(0, 60))
    guard.tare()
    read(slice(60, 65))
    assert guard.noise_n(-np.inf) == np.inf, "too few since then"
    read(slice(65, 80))
    assert guard.noise_n(-np.inf) == pytest.approx(0.2e-3, rel=0.5)


def test_the_lift_from_the_press_before_is_not_taken_for_noise() -> None:
    """At 50 Hz the lift and the way to the next station are over within one second: a scan ended
    because no force of ten times such a noise was measured half a millimetre deep."""
    limits = Limits(8.0, 3e-3, ((-1.0, 1.0),) * 3, 25e-3, hardest_n_m=1e3)
    feels = SensorGuard((Channel("force", "N", "force"),), limits)
    guard = PressGuard(feels, limits, 50.0)
    noise, read = np.random.default_rng(1), 0

    def read_force(force_n: Array) -> None:
        nonlocal read
        force = force_n + 0.2e-3 * noise.standard_normal(len(force_n))
        times = (read + np.arange(len(force))) / 50
        read += len(force)
        assert feels.check(Block(times, force[:, None], np.zeros((len(force), 1), bool))) is None

    def go(from_mm: float, to_mm: float, force_n: Array) -> None:
        start, target = Pose(0.0, 0.0, 1e-3 * from_mm), Pose(0.0, 0.0, 1e-3 * to_mm)
        guard.begin(start, target, 4e-3)
        read_force(force_n)
        guard.check(target, read / 50)

    read_force(np.zeros(60))
    go(5.0, -2.0, np.linspace(0.0, 0.4, 30))
    guard.end()
    read_force(np.full(60, 0.4))
    go(-2.0, 5.0, np.linspace(0.4, -0.5, 14).clip(0.0))
    guard.end()
    read_force(np.zeros(16))
    go(5.0, -0.5, np.linspace(-0.9, 0.08, 50).clip(0.0))
    assert guard.in_contact()


@pytest.mark.parametrize(
    ("late", "clips_mm", "noise_n", "seen"),
    [((), 2.22, 1e-3, True), ((9,), 2.22, 1e-3, True), ((), 2.32, 1e-3, True),
     ((), 2.32, 3e-3, False), ((), 3.0, 1e-3, False)],
)  # fmt: skip
def test_a_pose_that_came_late_early_in_a_press_hides_no_clipping_at_its_end(
    late: tuple[int, ...], clips_mm: float, noise_n: float, seen: bool
) -> None:
    """As on a busy machine: what is flat for 50 ms may not be excused by 20 ms long before. How
    near to the end a clip is seen, noise says and how old a pose may be; one that feels is not."""
    felt, limits = Felt(), Limits(1.6, 3e-3, ((-1.0, 1.0),) * 3, 25e-3, hardest_n_m=1e3)
    felt.noise = noise_n
    guard = PressGuard(cast(SensorGuard, felt), limits, 200.0)
    guard.begin(Pose(0.0, 0.0, 0.0), Pose(0.0, 0.0, -2.52e-3), 6e-3)
    said = []
    for n in range(1, 43):  # 10 ms and 60 um each
        felt.smooth_n = 0.48 * min(n * 60e-3, clips_mm)  # of 2.52 mm
        at = n - 1 if n in late else n
        said.append(guard.check(Pose(0.0, 0.0, -60e-6 * at), 10e-3 * n))
    guard.end()
    for n in range(43, 63):
        felt.smooth_n += 1e-5 * (-1) ** n
        said.append(guard.check(Pose(0.0, 0.0, -2.52e-3), 10e-3 * n))
    assert any(why is not None and "the sensor clips" in why for why in said) == seen


@pytest.mark.parametrize("filter_s", [0.0, 0.1])
def test_a_tare_may_come_while_a_block_is_judged(filter_s: float) -> None:
    """The sensor's thread judges, the scan's takes zero: once in many scans the judging ended in an
    error of its own, and the scan with it."""
    guard = SensorGuard(FT[:1], LIMITS, filter_s)
    over = Event()

    def tare() -> None:
        while not over.is_set():
            guard.tare()

    taring = Thread(target=tare)
    usual_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    taring.start()
    try:
        for n in range(1500):
            time_s = 0.01 * n + 1e-3 * np.arange(10)
            rng = np.random.default_rng(n)
            block = Block(time_s, 0.1 + 1e-6 * rng.random((10, 1)), np.zeros((10, 1), dtype=bool))
            assert guard.check(block) is None
    finally:
        over.set()
        taring.join()
        sys.setswitchinterval(usual_s)
