"""The controller's inside: registers, the program that obeys them, safety, and the phantom's tip.

Base frame = scan frame + ``origin_m``, axes parallel. The program is not interpreted: once one is
uploaded, the registers are obeyed as the library's own script obeys them.
"""

import threading
from typing import Any

import numpy as np

from sim_backend.phantom import Phantom

READY, DONE = 1, 2
MOVE_L, ZERO_FORCE, SPEED_L, SPEED_STOP, SERVO_STOP, SERVO_L = 3, 8, 10, 15, 16, 24
STOP_L, WATCHDOG, STOP_SCRIPT = 33, 35, 255
AT_ONCE = (SPEED_L, SERVO_L, 25)  # obeyed in each cycle: READY stays, DONE never comes
PLAYING, STOPPED = 2, 1
NORMAL_BIT, PROTECTIVE_BIT, EMERGENCY_BIT = 1 << 0, 1 << 2, 1 << 7
POWERED_BITS = 0b11  # power on, program running
STOP_M_S2 = 10.0
WATCHDOG_S = 0.5
REMEMBERED = 250
"""Cycles whose measurement is kept: every client of a cycle is told the same."""


Point = tuple[float, float, float]


class Robot:
    """Fields as RTDE names them; `Robot.outputs` is one sample. Safe to call from any thread."""

    def __init__(
        self, phantom: Phantom, origin_m: Point, noise_n: float, seed: int,
        period_s: float,
    ) -> None:  # fmt: skip
        self.period_s = period_s
        self._phantom = phantom
        self._origin = np.array(origin_m)
        self._noise_n = noise_n
        self._rng = np.random.default_rng(seed)
        self._lock = threading.RLock()
        self._start_s = phantom.clock.now()
        self._measured: dict[int, tuple[Point, float]] = {}
        self._rotation = (0.0, 0.0, 0.0)
        self._zero_n = 0.0
        self._inputs: dict[str, Any] = {}
        self._said = {"output_int_register_0": 0, "output_int_register_1": 0,
                      "output_int_register_2": 0}  # fmt: skip
        self._playing = False
        self._blocked = False
        self._wants_watchdog = False
        self._kicked_s = 0.0
        self._safety = NORMAL_BIT
        self.stuck = False
        """Programs do not start."""

    def upload(self) -> None:
        """A program has arrived: it starts, if safety lets it."""
        with self._lock:
            self._halt()  # it replaces the one that was running
            if self._safety == NORMAL_BIT and not self.stuck:
                self._playing = True
                self._blocked = self._wants_watchdog = False
                self._said["output_int_register_0"] = READY

    def end_program(self) -> None:
        """The program ends and the arm halts."""
        with self._lock:
            self._playing = False
            self._said["output_int_register_0"] = 0
            self._halt()

    def protect(self, bit: int) -> None:
        """A protective or emergency stop."""
        with self._lock:
            self._safety = bit
            self.end_program()

    def clear(self) -> None:
        """Safety is normal again; a program must be uploaded anew."""
        with self._lock:
            self._safety = NORMAL_BIT

    @property
    def playing(self) -> bool:
        return self._playing

    def written(self, values: dict[str, Any]) -> None:
        """Input registers that a client has set."""
        with self._lock:
            self._inputs.update(values)
            self._kicked_s = self._phantom.clock.now()
            command = self._inputs.get("input_int_register_0", 0)
            if not self._playing:
                return
            state = self._said["output_int_register_0"]
            if command == 0:
                self._said["output_int_register_0"] = READY
            elif state == READY and command in AT_ONCE:
                self._obey(command)
            elif state == READY:
                self._blocked = not self._obey(command)
                if not self._blocked and self._playing:
                    self._said["output_int_register_0"] = DONE

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
            tip, force = self._measured[cycle]
            pose = (*tip, *self._rotation)
            wrench = (0.0, 0.0, force - self._zero_n, 0.0, 0.0, 0.0)
            return {
                "timestamp": cycle * self.period_s,
                "actual_TCP_pose": pose,
                "target_TCP_pose": pose,
                "actual_TCP_force": wrench,
                "ft_raw_wrench": wrench,
                "robot_mode": 7,
                "safety_mode": 1 if self._safety == NORMAL_BIT else 3,
                "safety_status": 1 if self._safety == NORMAL_BIT else 3,
                "safety_status_bits": self._safety,
                "robot_status_bits": POWERED_BITS if self._playing else 1,
                "runtime_state": PLAYING if self._playing else STOPPED,
                "speed_scaling": 1.0,
                "target_speed_fraction": 1.0,
                **self._said,
            }

    def _measure(self, time_s: float) -> tuple[Point, float]:
        """Tip [m] and force [N] before zeroing, with its noise."""
        tip = np.array(self._phantom.tip.point(time_s)) + self._origin
        force = float(self._phantom.force_n(np.array([time_s]))[0])
        x, y, z = map(float, tip)
        return (x, y, z), force + self._noise_n * float(self._rng.standard_normal())

    def _go_on(self, now: float) -> None:
        moving = self._phantom.tip.moving(now)
        self._said["output_int_register_2"] = 1 if moving else -1
        if self._blocked and not moving:
            self._blocked = False
            if self._playing:
                self._said["output_int_register_0"] = DONE
        if self._wants_watchdog and self._playing and now - self._kicked_s > WATCHDOG_S:
            self.end_program()

    def _obey(self, command: int) -> bool:
        """Begin a command; False while it blocks the program (a move that is waited for)."""
        if command == MOVE_L:
            number = [float(self._inputs.get(f"input_double_register_{i}", 0)) for i in range(8)]
            target = np.array(number[:3]) - self._origin
            self._rotation = (number[3], number[4], number[5])
            x, y, z = map(float, target)
            self._phantom.tip.move(self._phantom.clock.now(), (x, y, z), number[6], number[7])
            return bool(self._inputs.get("input_int_register_1", 0))
        if command == ZERO_FORCE:
            now = self._phantom.clock.now()
            self._zero_n = float(self._phantom.force_n(np.array([now]))[0])
        elif command in (STOP_L, SPEED_STOP, SERVO_STOP):
            self._halt()
        elif command == WATCHDOG:
            self._wants_watchdog = True
        elif command == STOP_SCRIPT:
            self.end_program()
        return True

    def _halt(self) -> None:
        now = self._phantom.clock.now()
        if self._phantom.tip.moving(now):
            self._phantom.tip.halt(now, STOP_M_S2)
