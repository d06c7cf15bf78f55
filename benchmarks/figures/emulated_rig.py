"""A rig that is wrong in four ways, and its calibration by the commands a person would give.

The sensor reads 30 % too much and 8 ms late, the rig gives way by 1 mm at 2 N, and the block lies
tilted by 3 mm from end to end. Weights, a spring, a rigid block and the block itself are put under
the same rig; `palpate calibrate` reads the runs.
"""

from pathlib import Path

import numpy as np

import palpate
from drivers.core.arrays import Array
from probe.cli import main
from probe.scan.session import ScanResult
from sim_backend.phantom.phantom import Respond, Response
from sim_backend.scene.scene_file import Scene

GAIN, DELAY_MS, STIFFNESS_N_MM = 1.3, 8.0, 2.0
TILT_MM = 1.5  # up at x = 64 mm, down at 0
LOADS_N = (0.2, 0.5, 1.0, 2.0, 3.0, 2.0, 1.0, 0.5, 0.2)  # a press that feels nothing ends a scan
LOADED_MM = 3.0
SPRING_N_M, RIGID_N_M = 1e3, 1e8
TILTED = f"surface_mm = [[0, 0, {-TILT_MM}], [64, 0, {TILT_MM}], [32, 5, 0]]"

RIG = """
face_mm2 = 100
[stage]
driver = "virtual"
stiffness_n_mm = {stiffness}
[[sensor]]
driver = "virtual"
name = "cell"
gain = {gain}
latency_ms = {delay}
[scan]
{scan}
[safety]
max_force_n = 8.0
contact_within_mm = 2.5  # one end of its table is 1.3 mm too low
workspace_mm = {{ x = [-5.0, 70.0], y = [-5.0, 5.0], z = [-8.0, 50.0] }}
[scene]
name = "{scene}"
{lies}
[calibration]
{files}
"""


class Under:
    """What is under the probe: a spring."""

    def __init__(self, stiffness_n_m: float) -> None:
        self.stiffness_n_m = stiffness_n_m

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        depth = np.maximum(np.asarray(depth_m) + 0.0 * np.asarray(pressure_pa), 0.0)
        return np.asarray(self.stiffness_n_m * depth)

    def von_mises_pa(self, depth_m: Array, pressure_pa: Array) -> Array:
        return self.force_n(depth_m, pressure_pa) / 1e-4

    def __call__(self, _scene: Scene, _x_m: float, _depth_m: float) -> Response:
        return self


class WrongRig:
    """The rig; ``files`` are the calibrations it has so far, ``folder`` where all is kept."""

    def __init__(self, folder: Path, scene: str, respond: Respond) -> None:
        self.folder, self.scene, self.respond = folder, scene, respond
        self.files: dict[str, str] = {}

    def scan(self, scan: str, under: Respond | None = None, *, seed: int = 0) -> ScanResult:
        """Scan with the rig file as it is; the block unless something else is ``under`` it."""
        text = RIG.format(
            stiffness=STIFFNESS_N_MM, gain=GAIN, delay=DELAY_MS, scan=scan, scene=self.scene,
            lies="" if under else TILTED,
            files="\n".join(f'{kind} = "{name}"' for kind, name in self.files.items()),
        )  # fmt: skip
        rig = self.folder / "rig.toml"
        rig.write_text(text)
        done = palpate.scan(rig, out=self.folder / "runs", seed=seed, respond=under or self.respond)
        if done.ended.finish != "completed":
            raise RuntimeError(f"{scan}: {done.ended.reason}")
        return done

    def calibrate(self, kind: str, readings: Path, *more: str) -> None:
        """The command, and its file into the rig file from now on."""
        out = self.folder / f"{kind}.json"
        if main(["calibrate", kind, str(readings), "--out", str(out), *more]) != 0:
            raise RuntimeError(f"palpate calibrate {kind} {readings} failed")
        self.files[kind] = out.name

    def calibrate_all(self) -> None:
        """Known loads, a spring, a rigid block, and a dozen touches of the block itself."""
        one = "start_mm = 32.0\nstations = 1\n"
        rows = ["raw,load_n"]
        for n, load in enumerate(LOADS_N):
            in_series_mm = LOADED_MM - load / STIFFNESS_N_MM
            spring = Under(1e3 * load / in_series_mm)
            done = self.scan(one + f"indentation_mm = {LOADED_MM}", spring, seed=n)
            felt = palpate.open_run(done.path).samples()
            held = felt["force"].values[felt["phase"].values == "holding"]
            rows.append(f"{held[50:].mean()},{load}")
        table = self.folder / "weights.csv"
        table.write_text("\n".join(rows) + "\n")
        self.calibrate("force", table, "--device", "cell")
        taps = self.scan(one + "indentation_mm = 2.0\nrepeats = 4", Under(stiffness_n_m=SPRING_N_M))
        self.calibrate("latency", taps.path)
        block = self.scan(one + "indentation_mm = 1.0", Under(stiffness_n_m=RIGID_N_M))
        self.calibrate("compliance", block.path)
        touches = self.scan(
            "start_mm = [8.0, -4.0]\npitch_mm = [16.0, 4.0]\nstations = [4, 3]\n"
            "indentation_mm = 0.5\ntouch_n = 0.1\nsearch_mm = 2.0"
        )
        self.calibrate("surface", touches.path)
