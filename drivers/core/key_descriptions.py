"""What each key of a device's table means, for the schema that editors read and the site's pages.

A key means the same in every driver that has it, unless the driver has an entry of its own. A
driver made elsewhere describes its keys itself, by pydantic's `Field(description=...)`.
"""

COMMON = {
    "acceleration_mm_s2": "The acceleration of every move.",
    "address": "The register's address, counted from 0.",
    "answer_s": "A command that is not answered within this is a fault.",
    "array": "An array of taxels in the finger, in place of the load cell: a table of its own.",
    "arrived_mm": "A move has arrived when every axis is this near to its target.",
    "ask": "Sent before every reading, if the device speaks only when it is asked.",
    "axis": "The axis' name or number on its controller.",
    "baud": "Bits a second on the serial line.",
    "bias_mn": "A constant error of the reading.",
    "byte_order": "The order of a number's bytes on the line.",
    "channel": "One table for each channel, in the order of the stream.",
    "check": "The check sum at the end of each frame.",
    "columns": "Taxels in a row of the array.",
    "connect_s": "The library must connect within this, and its program start within as long.",
    "contact": "Who ends an approach by touch: the scan by the measured force alone, or also the "
    "controller by its own contact detection.",
    "counter": "Whether a byte after the header counts the frames, modulo 256.",
    "crosstalk_pct": "What each taxel also shows of each of its four neighbours.",
    "dead": "Taxels that read nothing, as [row, column] from 0.",
    "decimal": "The decimal sign of the numbers.",
    "device": "The device's address in the chain.",
    "device_id": "The device's Modbus address.",
    "drift_mn_s": "A steady drift of the reading.",
    "frequency_hz": "States a second; by default as many as the controller sends.",
    "full_scale": "Readings from here on count as saturated, in `unit`.",
    "full_scale_kpa": "Readings from here on count as saturated.",
    "full_scale_n": "Readings from here on count as saturated.",
    "gain": "Newtons read per newton felt.",
    "gain_spread_pct": "Standard deviation of the taxels' gains, drawn by the seed.",
    "header": "The bytes that begin a frame, in hexadecimal, such as `AA55`.",
    "home": "Whether a scan begins by moving to the limit switches. Connecting moves nothing.",
    "host": "The controller's address or name in the network.",
    "http_port": "The port of the box's configuration page.",
    "latency_ms": "How long after the touch a reading arrives at the earliest; it is subtracted "
    "from the time of arrival.",
    "limits_mm": "Lowest and highest place of each axis in the scan frame; no move goes beyond.",
    "max_speed_mm_s": "The fastest move that the stage is asked for.",
    "microsteps_per_mm": "Microsteps to a millimetre; negative where positions grow against the "
    "scan's axis.",
    "mode": "Whether the sensor streams by itself, or is asked for each reading.",
    "module": "The module's address on the line.",
    "motor": "The motor's number on its module.",
    "name": "What the device is called in the run and in messages.",
    "noise_mn": "Standard deviation of the white noise of the reading.",
    "noise_pa": "Standard deviation of the white noise of each taxel.",
    "normal": "Which component is the channel `force`, positive when pressed.",
    "number": "How a taxel's number is written: u unsigned, i signed, f floating, with its bits.",
    "offset": "Added to `scale` times the number.",
    "origin_mm": "Where the scan's (0, 0, 0) lies in the machine's coordinates.",
    "parity": "The parity of the serial line: N none, E even, O odd.",
    "park_mm": "Where the tip goes after homing, in the scan frame.",
    "pattern": "A regular expression (RE2) that a whole line must match; each named group is a "
    "channel.",
    "payload_centre_mm": "The payload's centre of mass in the flange's frame.",
    "payload_kg": "Set on the controller before the first move; otherwise it stays as it is.",
    "pitch_deg": "How the scan frame is turned about the base's y, after `roll_deg`.",
    "pitch_mm": "From taxel to taxel; without it they share the finger's face.",
    "port": "A serial port: a path, `COM3` (untested), or `socket://host:port`.",
    "quantum_mn": "The resolution of the reading.",
    "quantum_pa": "The resolution of each taxel.",
    "rate_hz": "Readings a second.",
    "rdt_port": "The UDP port that the box sends its records from.",
    "register": "One table for each channel.",
    "replace_program": "Whether a program that runs on the robot may be ended for the scan's own.",
    "role": "What the channel is: `force` (normal force), `pressure` (contact stress), `taxel`, "
    "`reference` (PPG or ECG), `depth` or `other`.",
    "roll_deg": "How the scan frame is turned about the base's x.",
    "rows": "Rows of the array.",
    "scale": "What the number is multiplied by to be in `unit`.",
    "seed": "Of the noise: the same seed gives the same readings.",
    "silence_s": "No reading for so long is a fault.",
    "silent_s": "A newest position report that is older than this is a fault.",
    "simulated": "Marks everything the device reads as simulated, such as that of an emulator.",
    "skin_spread_mm": "How deep under a skin it is felt: pressures spread so far sideways.",
    "source_id": "Which stream, where several have the same name.",
    "speed_unit_hz": "Microsteps a second to one unit of speed; 16 MHz / (2^pulse divisor x 2048 "
    "x 32) for a TMC428 or TMC429.",
    "status_hz": "Position reports asked for a second.",
    "steps_per_mm": "Full steps to a millimetre: one number, or one for each axis.",
    "stiffness_n_mm": "Of a rig that gives way: the tip is less deep than the stage reports.",
    "stop_s": "A stop that is not answered within this goes to the dashboard, which ends the "
    "program.",
    "stopbits": "Stop bits of the serial line.",
    "stream": "The stream's name.",
    "table": "Which of the device's Modbus tables is read.",
    "tcp_mm_rad": "The tool centre point (x, y, z, rotation vector), set on the controller before "
    "the first move; otherwise it stays as it is.",
    "tcp_port": "The port of a Modbus TCP device.",
    "thousands": "The sign between thousands, if the numbers have one.",
    "time_unit_s": "Seconds in one unit of the group `time`.",
    "timeout_ms": "An answer that comes later than this is not waited for.",
    "tool_rotvec_rad": "The tool's orientation (rotation vector) in the scan frame when it presses "
    "along -z.",
    "type": "How the register's number is stored; of 32 bits it takes two registers.",
    "unit": "The unit of the numbers, stored in SI.",
    "units_per_mm": "The controller's units to a millimetre (1000 where it counts micrometres); "
    "negative where positions grow against the scan's axis.",
    "watchdog_s": "The arm halts by itself when nobody has checked the force for so long.",
    "x": "The axis that moves along the scan's x.",
    "x_uri": "The controller that moves along x, such as `xi-com:/dev/ttyACM0`.",
    "y": "The axis that moves along the scan's y.",
    "y_uri": "The controller that moves along y.",
    "yaw_deg": "How the scan frame is turned about the base's z, last.",
    "z": "The axis that moves along the scan's z, upwards.",
    "z_uri": "The controller that moves along z, upwards.",
}
OWN = {
    ("modbus", "byte_order"): "How the bytes of a number lie on the line, A the highest: `CDAB` "
    "has its low word first, `BADC` swaps the bytes of each word.",
    ("modbus", "port"): "A serial port (RTU); give this or `host`.",
    ("modbus", "host"): "The address of a TCP device; give this or `port`.",
    ("lsl", "rate_hz"): "How often samples come, as the sender says.",
    ("ur", "rate_hz"): "Readings a second; by default as many as the controller sends.",
    ("ur", "normal"): "Which component is the channel `force`, positive when pressed: against the "
    "tool's own axis (`tool`), or along an axis of the base.",
    ("virtual", "latency_ms"): "How late the simulated readings come.",
}


def description(driver: str, key: str) -> str:
    """What ``key`` of ``driver`` means; empty where nobody has said it."""
    return OWN.get((driver, key)) or COMMON.get(key, "")
