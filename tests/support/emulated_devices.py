"""What a rig file says of the emulated sensors on a line."""

from typing import Any

REGISTER = {
    "name": "force", "address": 100, "unit": "N", "type": "int32", "scale": 0.001, "role": "force",
}  # fmt: skip
PRINTED: dict[str, Any] = {
    "pattern": "(?P<time>[0-9]+) (?P<force>[-+0-9.eE]+) N",
    "channel": [{"name": "force", "unit": "N", "role": "force"}],
    "rate_hz": 80.0,
    "time_unit_s": 0.001,
}
ARRAY: dict[str, Any] = {
    "rows": 4, "columns": 7, "header": "AA55", "rate_hz": 100.0, "counter": True,
    "check": "crc16-modbus", "scale": 10.0,
}  # fmt: skip
