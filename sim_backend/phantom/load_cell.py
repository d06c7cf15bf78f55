"""A simulated force sensor, and the paper's surface stress beside it."""

from dataclasses import dataclass

import numpy as np

from drivers.core.protocols import Channel
from sim_backend.arrays import Array, Bools
from sim_backend.phantom.phantom import Phantom


@dataclass(frozen=True)
class LoadCell:
    """Reading = quantised(clipped(gain force + bias + drift t + noise)). The stress is exact: no
    device measures it."""

    phantom: Phantom
    noise_n: float
    quantum_n: float
    full_scale_n: float
    gain: float
    bias_n: float
    drift_n_s: float

    @property
    def channels(self) -> tuple[Channel, ...]:
        return (
            Channel("force", "N", "force", simulated=True, full_scale=self.full_scale_n),
            Channel("von_mises", "Pa", "other", simulated=True),
        )

    @property
    def noise(self) -> Array:
        """Of the one channel that a device measures [N]."""
        return np.array([self.noise_n])

    def read(self, time_s: Array, since_start_s: Array, noise: Array) -> tuple[Array, Bools]:
        """Readings (n, 2) of what is felt at ``time_s`` (n,), and which of them are clipped."""
        force_n, stress = self.phantom.force_and_stress(time_s)
        force = self.gain * force_n + self.bias_n + noise[:, 0]
        force += self.drift_n_s * since_start_s
        read = np.clip(force, -self.full_scale_n, self.full_scale_n)
        if self.quantum_n:
            read = np.round(read / self.quantum_n) * self.quantum_n
        saturated = np.zeros((len(time_s), 2), dtype=bool)
        saturated[:, 0] = np.abs(force) >= self.full_scale_n
        return np.column_stack([read, stress]), saturated
