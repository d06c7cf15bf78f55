"""A finger in MuJoCo presses tissue with an artery in it, at 1 kHz, and feels its pulse.

Run: pip install mujoco
     python examples/mujoco_arm.py
"""

import math

import mujoco

import palpate

ARM = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <body name="finger">
      <joint name="along" type="slide" axis="1 0 0" damping="20"/>
      <joint name="up" type="slide" axis="0 0 1" damping="40"/>
      <geom type="cylinder" size="0.005 0.005" euler="90 0 0" mass="0.2" contype="0"/>
    </body>
  </worldbody>
  <actuator>
    <position joint="along" kp="2000"/>
    <position joint="up" kp="4000"/>
  </actuator>
</mujoco>
"""

scene = "TIHA"
felt = palpate.touch(scene)
low, high = 80.0, 120.0
model = mujoco.MjModel.from_xml_string(ARM)
arm = mujoco.MjData(model)
finger = model.body("finger").id
forces_n = []
for step in range(3000):
    time_s = 1e-3 * step
    arm.ctrl[:] = 0.032, -2.2e-3 * min(time_s, 1.0)  # down in a second, then held
    pressure_mmhg = low + (high - low) * (1 - math.cos(2 * math.pi * 1.2 * time_s)) / 2
    depth_mm = max(-1e3 * float(arm.qpos[1]), 0.0)
    x_mm = min(max(1e3 * float(arm.qpos[0]), 0.0), 64.0)
    force_n = float(felt.force_n(x_mm, depth_mm, pressure_mmhg))
    arm.xfrc_applied[finger, 2] = force_n
    mujoco.mj_step(model, arm)
    forces_n.append(force_n)

beats_n = forces_n[2000:]
pressed = palpate.press(scene, x_mm, depth_mm, pressures_mmhg=[pressure_mmhg])
off_pct = 100 * (force_n / pressed.states[0].force_n - 1)
print(f"held {depth_mm:.2f} mm deep at {x_mm:.1f} mm: {min(beats_n):.3f} to {max(beats_n):.3f} N")
print(f"the finite elements' force there: {pressed.states[0].force_n:.3f} N ({off_pct:+.2f} %)")
assert abs(off_pct) < 2
