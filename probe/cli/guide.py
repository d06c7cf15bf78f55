"""How to take the readings for each calibration, as printed by ``palpate calibrate KIND``."""

GUIDE: dict[str, str] = {
    "force": """\
1. Put known loads on the sensor, one axis at a time, up and down again, at least three levels.
2. Write one row per load: raw (or raw_0, raw_1 …) as the sensor reads it, untared, and load_n
   (or load_0_n, load_1_n …). A column temperature_c adds the temperature's term.
3. palpate calibrate force LOADS.csv --device SENSOR
Or let it take the readings: palpate calibrate force --live RIG.toml --device SENSOR asks for load
after load. palpate watch RIG.toml shows what the sensor reads now.""",
    "taxels": """\
1. Press the whole array evenly (a bladder, weights on a soft pad), at least three pressures.
2. Write one row per pressure: raw_0, raw_1 …, pressure_pa.
3. palpate calibrate taxels PRESSURES.csv --device SENSOR""",
    "gravity": """\
1. Hang the tool free and hold it still in six orientations or more, not all in one plane.
2. Write one row each: fx_n, fy_n, fz_n, mx_nm, my_nm, mz_nm; rx_rad, ry_rad, rz_rad (the sensor in
   the robot's base, rotation vector).
3. palpate calibrate gravity ORIENTATIONS.csv --device SENSOR""",
    "tare": """\
1. Leave the sensor unloaded for a minute.
2. Write its readings: time_s; value (or value_0, value_1 …).
3. palpate calibrate tare QUIET.csv --device SENSOR""",
    "tool": """\
1. Put the tip into a dimple and tilt the flange about it, eight poses, 20 degrees and more.
2. Write one row each: x_mm, y_mm, z_mm; rx_rad, ry_rad, rz_rad (the flange in the base).
3. palpate calibrate tool POSES.csv --device STAGE""",
    "axes": """\
1. Drive to eight places or more across the travel, also in height, and measure where each truly
   is (gauge, tracker, engraved plate).
2. Write one row each: x_mm, y_mm, z_mm as the stage reads; true_x_mm, true_y_mm, true_z_mm.
3. palpate calibrate axes PLACES.csv --device STAGE""",
    "surface": """\
1. Press lightly at a dozen places spread over the area (a grid of stations, indentation_mm = 0.5).
2. palpate scan RIG.toml --out runs
3. palpate calibrate surface runs/….run
Or a table of touches: x_mm, y_mm, z_mm. --model quadric or map for a curved surface.""",
    "latency": """\
1. Put something elastic under the probe (a steel spring, rubber; not tissue: it creeps).
2. Press it several times: palpate scan RIG.toml with stations = 1, repeats = 4.
3. palpate calibrate latency runs/….run
Or a table: time_s, depth_mm of the stage; sensor_time_s, force_n.""",
    "compliance": """\
1. Put a rigid block under the probe, its top where the scan takes the surface to be.
2. Press it gently, up to the largest force of your scans: palpate scan RIG.toml with
   stations = 1 and a small indentation_mm.
3. palpate calibrate compliance runs/….run
Or a table: depth_mm, force_n.""",
    "tissue": """\
1. Press plain tissue once, slowly, away from edges and lumps: palpate scan RIG.toml.
2. palpate calibrate tissue runs/….run --scene BLOCK.toml --scene-out TWIN.toml
   BLOCK.toml gives the block's size and the finger; --relaxation-s 0.5 fits the hold as well.
Or a table: depth_mm (true indentation), force_n, optional time_s.""",
    "heart": """\
1. Record ten quiet beats or more beside the scan (a PPG or ECG channel of role reference), or a
   tonometer; take a cuff reading.
2. palpate calibrate heart runs/….run --cuff 128/84 --scene SCENE.toml --scene-out SUBJECT.toml
Or a table: time_s, and reference (PPG, ECG: the rate) or pressure (tonometer: the wave too).""",
}
