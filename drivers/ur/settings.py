"""The keys of a UR's tables in a rig file."""

import math
from typing import Annotated, Literal

from pydantic import Field

from drivers.core.settings import Point, Positive, Settings

Rate = Annotated[float, Field(gt=0, le=500)]
Normal = Literal["tool", "+fx", "-fx", "+fy", "-fy", "+fz", "-fz"]


CONNECT_S = 9.0  # the library itself waits 5 s for its program to start
SILENCE_S = 0.1  # 50 cycles: far beyond any gap seen (reference/devices/ur.md); 2 mm at 20 mm/s
LOST_SEGMENT_S = 0.2
"""What a TCP segment that is lost costs at least: Linux' TCP_RTO_MIN, in which it is sent again."""
WATCHDOG_S = 0.35
"""(`LOST_SEGMENT_S` + `SILENCE_S`) * 8 / 7, rounded up: of eight resets in this time one may be
lost, and the line and both machines be late by as much as is no fault of the other direction."""


class UrStageSettings(Settings):
    """``[stage] driver = "ur"``.

    A place of the scan frame is turned by ``roll_deg``, ``pitch_deg`` and ``yaw_deg`` about the
    base's fixed x, y and z, in this order, then moved by ``origin_mm``: the base may be mounted in
    any way. ``tool_rotvec_rad``: the tool's orientation in the scan frame when it presses along
    -z. ``tcp_mm_rad`` and ``payload_kg`` are set on the controller before the first move if
    given, otherwise left as they are. ``replace_program``: a program that runs on the robot may be
    ended for this scan's own. ``frequency_hz``: by default the controller's own. ``contact``: who
    ends the approach of ``touch_n``; the scan by the sensor's force alone, or besides it the
    controller by its own contact detection, whose threshold nobody can set (PolyScope 5.4).

    What a busy machine may need longer: ``watchdog_s``, after which the arm halts by itself when
    nobody has checked the force (0.9 mm at 2.5 mm/s); ``stop_s``, in which a stop must be seen to
    work, beside what the arm takes to slow down: then the dashboard ends the program;
    ``answer_s``, after which a command that was not answered is a fault; ``silence_s``, after
    which the newest state is a fault; ``connect_s``, within which the library must have connected,
    and again its program have started. (Of a stage and a sensor on one robot, the first's count.)
    """

    name: str = "ur"
    host: str = "127.0.0.1"
    frequency_hz: Rate | None = None
    origin_mm: Point = (0.0, 0.0, 0.0)
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    tool_rotvec_rad: Point = (0.0, math.pi, 0.0)
    tcp_mm_rad: tuple[float, float, float, float, float, float] | None = None
    payload_kg: Annotated[float, Field(ge=0)] | None = None
    payload_centre_mm: Point = (0.0, 0.0, 0.0)
    acceleration_mm_s2: Positive = 500.0
    max_speed_mm_s: Positive = 100.0
    replace_program: bool = False
    contact: Literal["sensor", "controller"] = "sensor"
    watchdog_s: Positive = WATCHDOG_S
    stop_s: Positive = 0.1
    answer_s: Positive = 0.5
    silence_s: Positive = SILENCE_S
    connect_s: Positive = CONNECT_S


class UrSensorSettings(Settings):
    """``[[sensor]] driver = "ur"``.

    ``normal``: what the channel ``force`` is, positive when pressed: the push against the tool's
    own axis (``tool``), or a component in the base frame. ``rate_hz``: by default the
    controller's own.
    """

    name: str = "ur force"
    host: str = "127.0.0.1"
    rate_hz: Rate | None = None
    normal: Normal = "tool"
    full_scale_n: Positive = 50.0
    silence_s: Positive = SILENCE_S
    connect_s: Positive = CONNECT_S
