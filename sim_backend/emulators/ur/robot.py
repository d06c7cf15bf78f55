"""The controller's inside: registers, the program that obeys them, safety, and the phantom's tip.

The program is not interpreted: once one is uploaded, the registers are obeyed as the library's
own script obeys them.
"""

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim_backend.arrays import Array
from sim_backend.emulators.ur.contact import Contact
from sim_backend.emulators.ur.kinematics import POSTURE, Six
from sim_backend.emulators.ur.mounting import Mounting, Point
from sim_backend.phantom.phantom import Phantom, slope_at

READY, DONE = 1, 2
MOVE_L, ZERO_FORCE, SPEED_L, SPEED_STOP, SERVO_STOP, SET_PAYLOAD = 3, 8, 10, 15, 16, 17
SERVO_L, SET_TCP, STOP_L, WATCHDOG = 24, 29, 33, 35
JOINTS_NEAR, WITHIN_LIMITS, JOINTS_WITHIN_LIMITS, TCP_OFFSET, JOINTS = 30, 36, 37, 40, 46
TOOL_CONTACT, DETECT, END_DETECTION, READ_DETECTION = 25, 62, 63, 64
STOP_SCRIPT = 255
AT_ONCE = (SPEED_L, SERVO_L, TOOL_CONTACT)  # obeyed in each cycle: READY stays, DONE never comes
STOPPED, PLAYING, PAUSED = 1, 2, 4
RUNNING, POWER_OFF = 7, 3
NORMAL_MODE, PROTECTIVE_MODE, EMERGENCY_MODE = 1, 3, 7
POWERED_BIT, PROGRAM_BIT, TEACH_BIT = 0b1, 0b10, 0b100  # of robot_status_bits
TOOL_DOWN = (0.0, np.pi, 0.0)
STOP_M_S2 = 10.0
TICK_S = 0.01
RUNNING_BIT, NUMBER_SHIFT, NUMBERS = 1 << 15, 24, 128
"""Of the register in which the library's script reports an asynchronous move."""
REMEMBERED = 250
"""Cycles whose measurement is kept: every client of a cycle gets the same."""


class Robot:
    """Fields as RTDE names them; `Robot.outputs` is one sample. Safe to call from any thread."""

    def __init__(
        self,
        phantom: Phantom,
        mounting: Mounting,
        noise_n: float,
        seed: int,
        period_s: float,
        ready: Callable[[Point], bool] = lambda _target: True,
        contact_n: float = np.inf,
    ) -> None:
        self.period_s = period_s
        self.uploads = 0
        self.refuses: frozenset[int] = frozenset()
        """Commands that are never done."""
        self.ignores: frozenset[int] = frozenset()
        """Commands that are answered as if they were obeyed."""
        self.stuck = False
        """Programs do not start."""
        self.foreign = False
        """The program that plays is somebody else's."""
        self.floor_m = -np.inf
        """Height (scan frame) below which something keeps the arm from going."""
        self._ready = ready
        self._held = False
        self._phantom = phantom
        self._mounting = mounting
        self._noise_n = noise_n
        self._rng = np.random.default_rng(seed)
        self._lock = threading.RLock()
        self._start_s = phantom.clock.now()
        self._measured: dict[int, tuple[Point, Point, Point]] = {}
        rx, ry, rz = (mounting.turn * Rotation.from_rotvec(TOOL_DOWN)).as_rotvec().tolist()
        self._rotation = (rx, ry, rz)
        self._zero = np.zeros(3)
        self._slider = 1.0
        self._under_way: tuple[Point, float, float] | None = None
        self._tcp: Six = (0.0,) * 6
        self._payload_kg = 0.0
        self._inputs: dict[str, Any] = {}
        self._said: dict[str, Any] = {f"output_int_register_{n}": 0 for n in range(3)}
        self._number = 0
        self._playing = self._paused = False
        self._blocked = False
        self.teaches = False
        """The freedrive button is pressed."""
        self.mode = RUNNING
        self.ahead_s = 0.0
        """How far the controller's clock was set ahead."""
        self.contact = Contact(phantom, period_s, contact_n)
        self._watchdog_s = np.inf
        self._unheard_s, self._ticked_s = 0.0, 0.0
        self._safety = NORMAL_MODE

    def upload(self) -> None:
        """A program has arrived: it starts, if safety lets it."""
        with self._lock:
            self._halt()  # it replaces the one that was running
            self.contact.end_program()
            self.uploads += 1
            self.foreign = False
            self._paused = False
            if self._safety == NORMAL_MODE and self.mode == RUNNING and not self.stuck:
                self._playing = True
                self._blocked = False
                self._watchdog_s = np.inf
                self._said["output_int_register_0"] = READY

    def play_other(self) -> None:
        """Somebody else's program runs, which knows nothing of the registers."""
        with self._lock:
            self.foreign = self._playing = True

    def end_program(self) -> None:
        """The program ends and the arm halts."""
        with self._lock:
            self._playing = self._paused = self.foreign = False
            self.contact.end_program()
            self._said["output_int_register_0"] = 0
            self._halt()

    def pause(self) -> None:
        """Somebody presses *pause* on the pendant, or the freedrive button: the arm halts, and the
        program goes on from here when it is resumed."""
        with self._lock:
            if self._playing and not self._paused:
                under_way, self._paused = self._under_way, True
                self._halt()
                self._under_way = under_way

    def resume(self) -> None:
        """Somebody presses *play*."""
        with self._lock:
            if self._paused:
                self._paused, self._unheard_s = False, 0.0
                if self._under_way is not None:
                    self._set_off(*self._under_way)

    def power_off(self) -> None:
        """The brakes close."""
        with self._lock:
            self.mode = POWER_OFF
            self.end_program()

    def protect(self, mode: int) -> None:
        """A protective or emergency stop."""
        with self._lock:
            self._safety = mode
            self.end_program()

    def clear(self) -> None:
        """Safety is normal again; a program must be uploaded anew."""
        with self._lock:
            self._safety, self.mode = NORMAL_MODE, RUNNING
            self.teaches, self.ignores = False, frozenset()
            self.slide(1.0)
            self.resume()

    def slide(self, fraction: float) -> None:
        """The speed slider, from now on and for the move that is under way."""
        with self._lock:
            self._slider = fraction
            if self._under_way is not None and not self._paused:
                self._set_off(*self._under_way)

    def miss_cycles(self, seconds: float) -> None:
        """The controller loses time: its clock stands, while the arm and the world go on."""
        with self._lock:
            self._start_s += seconds

    @property
    def playing(self) -> bool:
        return self._playing

    def written(self, values: dict[str, Any]) -> None:
        """Input registers that a client has set."""
        with self._lock:
            self._go_on(self._phantom.clock.now())
            self._inputs.update(values)
            self._unheard_s = 0.0
            command = self._inputs.get("input_int_register_0", 0)
            if not self._playing or self.foreign:
                if command == STOP_SCRIPT:
                    self.end_program()
                return
            state = self._said["output_int_register_0"]
            if self.contact.stops or self._paused:
                pass  # its end is taken for that of a command which is given meanwhile
            elif command == 0:
                self._said["output_int_register_0"] = READY
            elif state == READY and command in AT_ONCE:
                self._obey(command)
            elif state == READY and command not in self.refuses:
                self._blocked = not self._obey(command)
                if not self._blocked and self._playing:
                    self._said["output_int_register_0"] = DONE
            elif command in self.refuses:
                self.end_program()  # as a script that fails does

    def tick(self) -> None:
        """Let the program go on, whether or not anybody listens.

        A time in which this machine did not come to tick is not held against the client.
        """
        with self._lock:
            now = self._phantom.clock.now()
            self._unheard_s += min(now - self._ticked_s, 2 * TICK_S)
            self._ticked_s = now
            self._go_on(now)
            if self._playing and not self._paused and self._unheard_s > self._watchdog_s:
                self.end_program()

    def until_s(self, cycle: int) -> float:
        """Seconds until a cycle begins; below 0 once it has."""
        return self._start_s + cycle * self.period_s - self._phantom.clock.now()

    def outputs(self, cycle: int) -> dict[str, Any]:
        """All fields in a cycle that has begun; what is measured is of its very beginning, however
        late the emulator gets to it."""
        with self._lock:
            self._go_on(self._phantom.clock.now())
            if cycle not in self._measured:
                self._measured[cycle] = self._measure(self._start_s + cycle * self.period_s)
                self._measured.pop(cycle - REMEMBERED, None)
            tip, velocity, force = self._measured[cycle]
            pose = (*tip, *self._rotation)
            fx, fy, fz = (np.array(force) - self._zero).tolist()
            wrench = (fx, fy, fz, 0.0, 0.0, 0.0)
            return {
                "timestamp": cycle * self.period_s + self.ahead_s,
                "actual_TCP_pose": pose,
                "target_TCP_pose": pose,
                "target_TCP_speed": (*velocity, 0.0, 0.0, 0.0),
                "actual_TCP_force": wrench,
                "ft_raw_wrench": wrench,
                "robot_mode": self.mode,
                "safety_mode": self._safety,
                "safety_status_bits": 1 << (self._safety - 1),
                "robot_status_bits": self._status_bits(),
                "runtime_state": self._runtime_state(),
                "speed_scaling": 1.0,
                "target_speed_fraction": 0.0 if self._held else self._slider,
                "payload": self._payload_kg,
                **self._said,
            }

    def _status_bits(self) -> int:
        bits = POWERED_BIT if self.mode == RUNNING else 0
        return bits | PROGRAM_BIT * self._playing | TEACH_BIT * self.teaches

    def _runtime_state(self) -> int:
        if not self._playing:
            return STOPPED
        return PAUSED if self._paused else PLAYING

    def _measure(self, time_s: float) -> tuple[Point, Point, Point]:
        """Tip [m], its velocity, and force [N] before zeroing, with its noise; in the base frame.

        Without friction the tissue pushes along the surface's normal.
        """
        place = self._phantom.tip.point(time_s)
        force_n = self._phantom.force_at(time_s)
        force_n += self._noise_n * float(self._rng.standard_normal())
        pushed = force_n * (self._mounting.matrix @ _normal(self._phantom, place))
        x, y, z = self._mounting.to_base(np.array(place)).tolist()
        vx, vy, vz = (self._mounting.matrix @ self._phantom.tip.velocity(time_s)).tolist()
        fx, fy, fz = pushed.tolist()
        return (x, y, z), (vx, vy, vz), (fx, fy, fz)

    def _go_on(self, now: float) -> None:
        heard_s = self.contact.found(now)
        given = self._inputs.get("input_int_register_0", 0)
        # The script drops a contact that is found while a command is being obeyed.
        if heard_s is not None and given == 0 and not self._blocked:
            self._under_way = None
            self.contact.stop(heard_s)
        if self.contact.stops and self.contact.go_on(now):
            self._said["output_int_register_0"] = DONE if given else READY
        if self._held and self._under_way is not None:
            self._set_off(*self._under_way)
        moving = self._phantom.tip.moving(now)
        if not moving and self._slider > 0 and not self._held and not self._paused:
            self._under_way = None
        busy = (moving or self._under_way is not None) and not self.contact.stops
        running = RUNNING_BIT if busy else 0
        self._said["output_int_register_2"] = self._number << NUMBER_SHIFT | running
        if self._blocked and not moving:
            self._blocked = False
            if self._playing:
                self._said["output_int_register_0"] = DONE

    def _obey(self, command: int) -> bool:
        """Begin a command; False while it blocks the program (a move that is waited for)."""
        now = self._phantom.clock.now()
        if command in self.ignores:
            return True
        if command == MOVE_L:
            target = self._mounting.to_scan(np.array(self._numbers(3)))
            rx, ry, rz, speed, acceleration = self._numbers(8)[3:]
            self._rotation = (rx, ry, rz)
            x, y, z = target.tolist()
            self._number = (self._number + 1) % NUMBERS
            self._set_off((x, y, z), speed, acceleration)
            return bool(self._inputs.get("input_int_register_1", 0))
        if command == ZERO_FORCE:
            place = self._phantom.tip.point(now)
            force_n = self._phantom.force_at(now)
            self._zero = force_n * (self._mounting.matrix @ _normal(self._phantom, place))
        elif command in (STOP_L, SPEED_STOP, SERVO_STOP):
            self._halt(self._numbers(1)[0])
            if command == STOP_L and not self._inputs.get("input_int_register_1", 0):
                return False
            self._number = (self._number + 1) % NUMBERS
        elif command == TOOL_CONTACT:
            self._said["output_int_register_1"] = self.contact.steps(now)
        elif command == DETECT:
            self.contact.start(now)
        elif command in (END_DETECTION, READ_DETECTION):
            if command == END_DETECTION:
                self.contact.end()
            self._said["output_int_register_1"] = self.contact.steps_back
        elif command == WATCHDOG:
            self._watchdog_s = 1 / self._numbers(1)[0]
        elif command == SET_TCP:
            self._tcp = _six(self._numbers(6))
        elif command == SET_PAYLOAD:
            self._payload_kg = self._numbers(1)[0]
        elif command == WITHIN_LIMITS:
            near = float(np.linalg.norm(self._numbers(3))) <= self._mounting.reach_m
            can = near and self._joints(POSTURE) is not None
            self._said["output_int_register_1"] = int(can)
        elif command in (JOINTS, JOINTS_NEAR):
            near_to = POSTURE if command == JOINTS else _six(self._numbers(12)[6:])
            if (joints := self._joints(near_to)) is None:
                self.end_program()  # as a script that fails does
            else:
                self._said |= {f"output_double_register_{n}": at for n, at in enumerate(joints)}
        elif command == JOINTS_WITHIN_LIMITS:
            turned = max(map(abs, self._numbers(6)))
            self._said["output_int_register_1"] = int(turned <= self._mounting.joint_limit_rad)
        elif command == TCP_OFFSET:
            self._said |= {f"output_double_register_{n}": at for n, at in enumerate(self._tcp)}
        elif command == STOP_SCRIPT:
            self.end_program()
        return True

    def _joints(self, near: Six) -> Six | None:
        return self._mounting.inverse(_six(self._numbers(6)), self._tcp, near)

    def _numbers(self, count: int) -> list[float]:
        return [float(self._inputs.get(f"input_double_register_{n}", 0)) for n in range(count)]

    def _set_off(self, target: Point, speed: float, acceleration: float) -> None:
        self._under_way = (target, speed, acceleration)
        now = self._phantom.clock.now()
        self._held = not self._ready(target)
        if self._held:
            return
        if self._slider <= 0:
            self._phantom.tip.halt(now, STOP_M_S2)
        else:
            way = self._unhindered(now, target)
            self._phantom.tip.move(now, way, self._slider * speed, acceleration)

    def _unhindered(self, now: float, target: Point) -> Point:
        """How far on the way to ``target`` the arm gets."""
        here = np.array(self._phantom.tip.point(now))
        way = np.array(target) - here
        share = 1.0
        if target[2] < min(self.floor_m, here[2]):
            share = max((self.floor_m - here[2]) / way[2], 0.0)
        x, y, z = (here + share * way).tolist()
        return (x, y, z)

    def _halt(self, deceleration_m_s2: float = STOP_M_S2) -> None:
        self._under_way, self._held = None, False
        now = self._phantom.clock.now()
        if self._phantom.tip.moving(now):
            self._phantom.tip.halt(now, deceleration_m_s2)


def _six(numbers: list[float]) -> Six:
    a, b, c, d, e, f = numbers
    return (a, b, c, d, e, f)


def _normal(phantom: Phantom, place: Point) -> Array:
    """Outward normal (3,) of the surface under a place, scan frame."""
    along_x, along_y = slope_at(phantom.surface, place)
    normal = np.array([-along_x, -along_y, 1.0])
    return np.asarray(normal / np.linalg.norm(normal))
