"""A UR arm as a stage: straight tool moves that can be stopped, poses in the scan frame."""

import math
import time
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.core.abilities import StopMeans
from drivers.core.errors import DeviceFault, MotionFault
from drivers.core.extras import require_library
from drivers.core.protocols import Clock, Pose
from drivers.core.stage_limits import check_speed
from drivers.ur.alone import Lift
from drivers.ur.client import REDUCED, Control, State
from drivers.ur.link import Link, leave_link, renew_link, take_link
from drivers.ur.settings import UrStageSettings

ARRIVED_M = 0.1e-3
STILL_M, STILL_S = 5e-6, 0.02
MAX_SPEED_AT_REST = 1e-6  # m/s and rad/s asked of the tool: a move that has ended asks for 0
SETTLES_S = 0.2  # the joints follow their targets within this long
REACH_S = 0.3  # three questions take some of the controller's cycles each, of a CB3 8 ms each
FULL_PACE = 0.995


class UrStage:
    """An arm; see `UrStageSettings`."""

    turns = True

    def __init__(self, settings: UrStageSettings) -> None:
        keys = settings
        self.name = keys.name
        self.simulated = keys.simulated
        self.max_speed_m_s = 1e-3 * keys.max_speed_mm_s
        self._settings = keys
        self._origin_m = 1e-3 * np.array(keys.origin_mm)
        self._mounted = Rotation.from_euler(
            "xyz", [keys.roll_deg, keys.pitch_deg, keys.yaw_deg], degrees=True
        )
        self._tool = Rotation.from_rotvec(keys.tool_rotvec_rad)
        self._link: Link | None = None
        self._target: Pose | None = None
        self.finds_contact = keys.contact == "controller"
        self._searches = self._touched = False
        self._rests_since_s: float | None = None
        self._set_off_s = 0.0
        self._lift: Lift | None = None

    @property
    def pace(self) -> float:
        """The share of a commanded speed that the controller allows now (its speed slider)."""
        return self._there().state().pace

    def why_still(self) -> str | None:
        """The speed slider, where it slows or holds a move. Raises `DeviceFault`."""
        pace = self.pace
        return None if pace >= FULL_PACE else f"its speed slider is at {100 * pace:.3g} %"

    def connect(self) -> None:
        """Connect for reading: nothing changes on the robot. Raises `DeviceAbsent`."""
        if self._link is None:
            keys = self._settings
            self._link = take_link(
                self.name, keys.host, keys.frequency_hz, keys.silence_s, keys.connect_s
            )

    @property
    def enable_s(self) -> float:
        """How long `enable` may take: `connect_s` of the rig file."""
        return self._settings.connect_s

    def enable(self) -> list[str]:
        """Upload the control program, set TCP and payload; what then holds, in words.

        Raises `DeviceFault`, also where another program runs and may not be replaced.
        """
        link, keys = self._there(), self._settings
        if self.finds_contact and not link.controller.finds_contact:
            raise DeviceFault(
                self.name, f'contact = "controller" needs PolyScope 5.4 or newer; this is '
                f"{link.controller.described}: leave the key out"
            )  # fmt: skip
        tcp = keys.tcp_mm_rad
        cx, cy, cz = (1e-3 * v for v in keys.payload_centre_mm)
        setup = Control(
            None if tcp is None else (*(1e-3 * v for v in tcp[:3]), *tcp[3:]),
            keys.payload_kg,
            (cx, cy, cz),
            keys.watchdog_s,
        )
        found = link.take_control(setup, replace_program=keys.replace_program)
        if self._lift is not None:
            link.lift_when_alone(self._lift)
        return _in_words(link, found) if found else []

    def pose(self) -> Pose:
        """The tool centre point in the scan frame."""
        return self._pose(self._there().state())

    def base_pose(self) -> Pose:
        """The tool centre point in the robot's base frame; a frame is taught from it."""
        return Pose(*self._there().state().pose)

    def unreachable(self, poses: Sequence[Pose]) -> dict[Pose, str]:
        """Those that the controller cannot go to in this order, or may not by its safety limits,
        and why; among them joints at their limits and singularities."""
        link, keys = self._there(), self._settings
        asked = [self._base(pose) for pose in poses]
        why_not = link.command(
            "why not", asked, 1e-3 * keys.max_speed_mm_s,
            timeout_s=keys.answer_s + REACH_S * len(asked),
        )  # fmt: skip
        return {pose: why for pose, why in zip(poses, why_not, strict=True) if why}

    def move(self, target: Pose, speed_m_s: float) -> None:
        """Set off in a straight line. Raises `DeviceFault` if refused."""
        self._go("move", target, speed_m_s)

    def search(self, target: Pose, speed_m_s: float) -> None:
        """As `move`; at a contact the controller stops, and goes back to where it began."""
        self._go("search", target, speed_m_s)
        self._searches = True

    @property
    def touched(self) -> bool:
        """Whether the controller has ended the last `search` at a contact; while it still goes
        back from there, what its program says of the move."""
        target, state = self._target, None
        if self._searches and target is not None:
            with suppress(DeviceFault):
                state = self._there().state()
            if state is not None and state.arrival_s >= self._set_off_s and not state.busy:
                return self._off_m(state, target) > ARRIVED_M
        return self._touched

    def _go(self, order: str, target: Pose, speed_m_s: float) -> None:
        keys = self._settings
        check_speed(self.name, keys.max_speed_mm_s, speed_m_s)
        link = self._there()
        if not link.controls:
            self.enable()
        link.state()  # a program that has ended is not started again by a move
        self._target, self._rests_since_s = target, None
        self._searches = self._touched = False
        acceleration_m_s2 = 1e-3 * keys.acceleration_mm_s2
        link.command(
            order, self._base(target), speed_m_s, acceleration_m_s2, timeout_s=keys.answer_s
        )
        self._set_off_s = time.monotonic()

    def moving(self) -> bool:
        """True until the controller says that the move has ended and the tip rests.

        Raises `MotionFault` if it rests elsewhere than commanded.
        """
        link = self._there()
        state, before = link.state(), link.earlier(STILL_S)
        # by the controller's time: on a busy machine states come late, and the arm is not at rest
        still = before is not None and math.dist(state.pose[:3], before.pose[:3]) < STILL_M
        asked = max(map(abs, state.target_speed))  # of one packet with the pose
        rests = still and asked < MAX_SPEED_AT_REST
        if state.busy or not rests or state.arrival_s < self._set_off_s:
            self._rests_since_s = None
            return True
        if self._searches:
            self._searches = False
            self._touched = link.command("touched", timeout_s=self._settings.answer_s)
            self._target = None if self._touched else self._target
            self._set_off_s = time.monotonic()  # it may only now have gone back from the contact
            return True
        if self._target is None:
            return False
        off_m = self._off_m(state, self._target)
        if off_m < ARRIVED_M:
            self._target = None
            return False
        if self._rests_since_s is None:
            self._rests_since_s = state.timestamp_s
        if state.timestamp_s - self._rests_since_s > SETTLES_S:
            self._target = None
            raise MotionFault(self.name, f"came to rest {1e3 * off_m:.2f} mm from its target")
        return True

    def keep_alive(self) -> None:
        """Whoever checks the force has just done so; the robot stops when this is not called."""
        if (link := self._link) is not None:
            link.guarded()

    def start_again(self) -> None:
        """Connect again where the connection was cut, or upload the program again that ended
        because the robot heard nothing of us; one that a person may have ended stays so.

        After a cut the next `move` uploads it, once the robot's watchdog has ended the last one.
        Raises `DeviceFault` or `DeviceAbsent`.
        """
        link = self._there()
        if link.lost_in_control():
            self._link = renew_link(link, self._settings.connect_s)
        elif link.program_ended_by_us():
            self.enable()

    def lift_when_alone(self, z_m: float, speed_m_s: float) -> None:
        """Where this process dies, the client's lifts the tip straight up to ``z_m``."""
        normal = self._mounted.apply((0.0, 0.0, 1.0))
        x, y, z = map(float, normal)
        height_m = float(normal @ self._origin_m) + z_m
        self._lift = Lift((x, y, z), height_m, speed_m_s, 1e-3 * self._settings.acceleration_mm_s2)
        self._there().lift_when_alone(self._lift)

    def stop_means(self) -> tuple[StopMeans, ...]:
        """Its program's ``stopL``; the end of the program; the brakes."""
        link, keys = self._link, self._settings
        state = None if link is None else link.newest()
        speed_m_s = self.max_speed_m_s if state is None else math.hypot(*state.target_speed[:3])
        slows_s = speed_m_s / (1e-3 * keys.acceleration_mm_s2)
        within_s = keys.answer_s + slows_s
        return (
            StopMeans("stopL", self.stop, keys.stop_s + slows_s),
            StopMeans("dashboard stop", self._end_program, within_s),
            StopMeans("dashboard power off", self._close_brakes, within_s, lifts=False),
        )

    def stop(self) -> None:
        """Halt where it is."""
        self._target, self._searches = None, False
        if (link := self._link) is not None:
            link.stop(1e-3 * self._settings.acceleration_mm_s2, self._settings.stop_s)

    def _end_program(self) -> None:
        if (link := self._link) is not None and not link.rests():
            link.end_program()

    def _close_brakes(self) -> None:
        """Only of an arm that is seen to move: with its brakes closed nobody can lift it soon."""
        if (link := self._link) is not None and link.moves():
            link.close_brakes()

    def close(self) -> None:
        """Halt and disconnect."""
        self.stop()
        link, self._link = self._link, None
        if link is not None:
            leave_link(link)

    def _off_m(self, state: State, target: Pose) -> float:
        return math.dist(self._pose(state)[:3], target[:3])

    def _pose(self, state: State) -> Pose:
        place = self._mounted.inv().apply(np.array(state.pose[:3]) - self._origin_m)
        turn = self._mounted.inv() * Rotation.from_rotvec(state.pose[3:]) * self._tool.inv()
        return Pose(*map(float, place), *map(float, turn.as_rotvec()))

    def _base(self, pose: Pose) -> tuple[float, ...]:
        place = self._origin_m + self._mounted.apply(pose[:3])
        turn = self._mounted * Rotation.from_rotvec(pose[3:]) * self._tool
        return (*map(float, place), *map(float, turn.as_rotvec()))

    def _there(self) -> Link:
        if self._link is None:
            raise DeviceFault(self.name, "not connected")
        return self._link


def _in_words(link: Link, found: dict[str, object]) -> list[str]:
    state, tcp = link.state(), found["tcp"]
    assert isinstance(tcp, tuple)
    place = ", ".join(f"{1e3 * v:.1f}" for v in tcp[:3])
    payload_kg = found["payload_kg"]
    carries = "not reported" if payload_kg is None else f"{payload_kg:.2f} kg"
    reduced = "reduced" if state.safety_mode == REDUCED else "normal"
    notes = [
        f"{link.controller.described} at {link.rate_hz:g} Hz, safety mode {reduced}, speed slider "
        f"{100 * state.pace:.0f} %, tool centre {place} mm, payload {carries}"
    ]
    if state.pace < FULL_PACE:
        notes.append(f"the controller slows every move to {100 * state.pace:.0f} % of its speed")
    return notes


def open_stage(_clock: Clock, settings: UrStageSettings) -> UrStage:
    """The arm at ``settings.host``, not yet connected. Raises `MissingExtra`."""
    require_library("ur")
    return UrStage(settings)
