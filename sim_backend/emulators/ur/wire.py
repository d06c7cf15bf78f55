"""RTDE on the wire: big-endian packages `u16 size | u8 type | payload`, and fields by name.

Universal Robots, "RTDE guide": names and types of the fields.
"""

import struct
from collections.abc import Iterator, Mapping
from typing import Any

VERSION, CONTROLLER, OUTPUTS, INPUTS = ord("V"), ord("v"), ord("O"), ord("I")
START, PAUSE, DATA, TEXT = ord("S"), ord("P"), ord("U"), ord("M")

FORMATS = {
    "DOUBLE": "d", "INT32": "i", "UINT32": "I", "UINT64": "Q", "UINT8": "B", "BOOL": "?",
    "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i",
}  # fmt: skip
_SIX = """target_q target_qd target_qdd target_current target_moment actual_q actual_qd
actual_current joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force
target_TCP_pose target_TCP_speed joint_temperatures actual_joint_voltage payload_inertia
ft_raw_wrench external_force_torque actual_current_window actual_current_as_torque"""
_ONE = """timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum
actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0
standard_analog_input1 standard_analog_output0 standard_analog_output1 payload tcp_force_scalar
standard_analog_output_0 standard_analog_output_1 speed_slider_fraction"""
TYPES: dict[str, str] = {
    **dict.fromkeys(_SIX.split(), "VECTOR6D"),
    **dict.fromkeys(_ONE.split(), "DOUBLE"),
    **dict.fromkeys(
        ("actual_tool_accelerometer", "payload_cog", "elbow_position", "elbow_velocity"), "VECTOR3D"
    ),
    **dict.fromkeys(("robot_mode", "safety_mode", "safety_status"), "INT32"),
    **dict.fromkeys(
        ("runtime_state", "robot_status_bits", "safety_status_bits", "analog_io_types",
         "speed_slider_mask"), "UINT32"
    ),
    **dict.fromkeys(("actual_digital_input_bits", "actual_digital_output_bits"), "UINT64"),
    **dict.fromkeys(
        ("standard_digital_output", "standard_digital_output_mask", "configurable_digital_output",
         "configurable_digital_output_mask", "tool_digital_output", "tool_digital_output_mask",
         "standard_analog_output_mask", "standard_analog_output_type"), "UINT8"
    ),
    "joint_mode": "VECTOR6INT32",
}  # fmt: skip


def type_of(name: str) -> str:
    """The field's type; NOT_FOUND as a controller says of a name that it does not know."""
    if "_int_register_" in name:
        return "INT32"
    if "_double_register_" in name:
        return "DOUBLE"
    if "_bit_registers" in name:
        return "UINT32"
    if "_bit_register_" in name:
        return "BOOL"
    return TYPES.get(name, "NOT_FOUND")


def package(kind: int, payload: bytes) -> bytes:
    """One package."""
    return struct.pack(">HB", 3 + len(payload), kind) + payload


def packages(buffer: bytearray) -> Iterator[tuple[int, bytes]]:
    """Take the whole packages out of what has arrived."""
    while len(buffer) >= 3:
        size, kind = struct.unpack_from(">HB", buffer)
        if size < 3:
            buffer.clear()
            return
        if len(buffer) < size:
            return
        payload = bytes(buffer[3:size])
        del buffer[:size]
        yield kind, payload


class Recipe:
    """An agreed list of fields under a number."""

    def __init__(
        self, number: int, names: list[str], unknown: frozenset[str] = frozenset()
    ) -> None:
        self.number = number
        self.names = names
        self.types = ["NOT_FOUND" if name in unknown else type_of(name) for name in names]
        self._fields: list[tuple[str, struct.Struct, int]] = []
        self._size = 1  # its number comes first
        for name, kind in zip(names, self.types, strict=True):
            form = struct.Struct(">" + FORMATS.get(kind, ""))
            self._fields.append((name, form, self._size))
            self._size += form.size

    def answer(self) -> bytes:
        """Number and types, as the controller confirms a recipe."""
        return bytes([self.number]) + ",".join(self.types).encode()

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """A data package's payload; what ``values`` lacks is 0."""
        packed = bytearray(self._size)
        packed[0] = self.number
        for name, form, at in self._fields:
            value = values.get(name)
            if value is not None:
                form.pack_into(packed, at, *(value if isinstance(value, tuple) else (value,)))
        return bytes(packed)

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """The values of a data package (without its number)."""
        values: dict[str, Any] = {}
        for name, form, at in self._fields:
            got = form.unpack_from(payload, at - 1)
            values[name] = got if len(got) > 1 else got[0]
        return values
