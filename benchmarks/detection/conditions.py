"""The conditions of flights: what is drawn for each flight, and what is flown."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.detection.plant import FAILURES, Mission, Truth, fill

LAG, DELAY = 0.05, 0.01
"""What the detector is told: time constant of the motors, delay and age together [s]."""

NOISE = {'position_noise': 0.01, 'velocity_noise': 0.03, 'attitude_noise': 0.005,
         'rate_noise': 0.02, 'force_noise': 0.3}  # fmt: skip
"""Standard deviations of sensors, as on the pages; of the accelerometer 0.3 m/s^2."""

CALM = {
    'speed': 3.0, 'acceleration': 2.5, 'tilt': 0.7, 'stiffness': 1.0, 'turn': 1.0,
    'reach': 8.0, 'low': 3.0, 'high': 10.0, 'shortest': 2.0, 'longest': 6.0,
}  # fmt: skip
SHARP = {
    'speed': 9.0, 'acceleration': 7.0, 'tilt': 0.75, 'ahead': 0.8, 'stiffness': 1.4, 'turn': 2.0,
    'reach': 25.0, 'low': 5.0, 'high': 15.0, 'shortest': 2.0, 'longest': 5.0,
}  # fmt: skip
HOPS = {**CALM, 'speed': 2.0, 'low': 0.8, 'high': 1.6, 'period': 15.0}
PUSHED = {'pushes': 60.0, 'briefest': 0.1, 'lasting': 1.0}
"""A push in each minute, of 0.3 m g if it is not set, for 0.1 to 1 s."""
PUSHES = {**CALM, **PUSHED}


@dataclass(frozen=True)
class Condition:
    """How flights are drawn.  A pair is a range; a sign is drawn for `lag`.

    - `lag`: relative error of the lag that the detector is told
    - `spread`: standard deviation of k_f and k_tau of rotors, relative
    - `wind` [m/s]: its speed; `turbulence`: the speed that sets its intensity, over that of the
      wind
    - `air`: factor of the effects of air on rotors and body
    - `mismatch`: factor of the errors of mass, inertia, centre of mass, and of the battery
    - `payload`: share of the mass that is dropped in half of the flights, less if there is less
      than the weight of thrust to spare
    - `delay`, `age` [s]: true; together 10 ms are told
    - `imu`: factor of bias, vibration and displacement of the accelerometer
    """

    mission: Mapping[str, float] = field(default_factory=lambda: CALM)
    lag: tuple[float, float] = (0.2, 0.2)
    spread: tuple[float, float] = (0.03, 0.03)
    wind: tuple[float, float] = (0.0, 3.0)
    turbulence: float = 1.0
    air: float = 1.0
    mismatch: float = 1.0
    payload: tuple[float, float] = (0.05, 0.15)
    delay: float = 0.005
    age: float = 0.005
    jitter: float = 0.0025
    imu: float = 1.0
    more: Mapping[str, Any] = field(default_factory=dict)

    def draw(
        self, vehicle: Any, rng: np.random.Generator, duration: float,
        failure: Mapping[str, float] | None = None,
    ) -> tuple[Any, Any]:
        """Return the truth and the mission of a flight of a duration [s]."""
        n, uniform, normal = int(vehicle.n), rng.uniform, rng.standard_normal
        sign = rng.choice([-1.0, 1.0])
        spread, m, air = uniform(*self.spread), self.mismatch, self.air
        lag = LAG * (1.0 + sign * uniform(*self.lag)) * (1.0 + 0.05 * m * normal(n))
        speed, angle = uniform(*self.wind), uniform(-np.pi, np.pi)
        up, direction = uniform(-0.05, 0.05), normal(3)
        hook = np.append(uniform(-0.03, 0.03, 2), -0.05)
        weight = vehicle.mass * vehicle.gravity
        spare = n * vehicle.thrust * vehicle.fastest**2 / weight - 1.0
        loaded = min(1.0, spare) * (rng.random() < 0.5)
        values = {
            'mass_factor': 1.0 + 0.03 * m * uniform(-1, 1),
            'inertia_factor': 1.0 + 0.08 * m * uniform(-1, 1, 3),
            'centre': 0.004 * m * uniform(-1, 1, 3),
            'thrust_factor': 1.0 + spread * np.clip(normal(n), -2.0, 2.0),
            'torque_factor': 1.0 + spread * np.clip(normal(n), -2.0, 2.0),
            'lag': np.clip(lag, 0.005, 0.2), 'braking': 1.0 + 0.3 * m * rng.random(),
            'delay': self.delay, 'age': self.age, 'jitter': self.jitter,
            'sag': 0.05 * m * rng.random(), 'sag_rate': m * 0.03 * rng.random() / duration,
            'sag_load': 0.02 * m * rng.random(),
            'flapping': 5e-4 * air * uniform(0.8, 1.2), 'hub_moment': 0.15 * air * rng.random(),
            'inflow': 0.5 * air * uniform(0.7, 1.3), 'wake': 0.2 * air * rng.random(),
            'coaxial': 0.3 * air, 'body_drag': 0.012 * air * uniform(0.7, 1.3),
            'pressure': 0.01 * air * normal(3), 'ground_effect': uniform(1.0, 3.0) * (air > 0.0),
            'sink': uniform(0.0015, 0.005), 'damping': uniform(0.3, 0.8),
            'friction': uniform(0.4, 1.0), 'uneven': 0.01 * m * uniform(-1, 1, 4),
            'wind': speed * np.array([np.cos(angle), np.sin(angle), up]),
            'turbulence': self.turbulence * speed,
            'payload': vehicle.mass * uniform(*self.payload) * loaded, 'hook': hook,
            'dropped': duration * uniform(0.2, 0.8),
            **NOISE, 'force_bias': 0.1 * self.imu * direction, 'imu': 0.03 * self.imu * normal(3),
            'vibration': self.imu * uniform(1.0, 5.0),
        }
        mission = {**self.mission, **(failure or {})}
        if 'pushes' in mission:
            mission.setdefault('push', 0.3 * weight)
        return fill(Truth(), **{**values, **self.more}), fill(Mission(), **mission)


NOTHING: dict[str, Any] = {
    'lag': (0.0, 0.0), 'spread': (0.0, 0.0), 'wind': (0.0, 0.0), 'air': 0.0, 'mismatch': 0.0,
    'payload': (0.0, 0.0), 'jitter': 0.0, 'imu': 0.0,
}
"""Nothing differs from what is believed; sensors have noise."""

FLOWN = {
    'ideal': Condition(**NOTHING),
    'usual': Condition(),
    'turbulence': Condition(wind=(4.0, 8.0), lag=(0.2, 0.3), spread=(0.03, 0.05)),
    'aggressive': Condition(SHARP, lag=(0.2, 0.35), spread=(0.05, 0.08)),
    'landings': Condition(HOPS, wind=(0.0, 5.0), lag=(0.2, 0.3), spread=(0.03, 0.05)),
    'pushes': Condition(PUSHES),
    'latency': Condition(SHARP, lag=(0.2, 0.35), spread=(0.05, 0.08), delay=0.01, age=0.01),
}
FLOWN |= {
    'pushes in turbulence': replace(FLOWN['turbulence'], mission=PUSHES),
    'aggressive pushes': replace(FLOWN['aggressive'], mission={**SHARP, **PUSHED}),
    'long pushes': Condition({**PUSHES, 'briefest': 1.0, 'lasting': 3.0}),
}
"""The conditions of the tables."""

CAUSES = {
    'none': Condition(**NOTHING),
    'latency doubled': Condition(**{**NOTHING, 'delay': 0.01, 'age': 0.01}),
    'jitter 5 ms': Condition(**{**NOTHING, 'jitter': 0.005}),
    'pushes of 10 N': Condition({**PUSHES, 'push': 10.0}, **NOTHING),
    'pushes of 5 N': Condition({**PUSHES, 'push': 5.0}, **NOTHING),
    'lag off by half': Condition(**{**NOTHING, 'lag': (0.5, 0.5)}),
    'inflow and flapping': Condition(**{**NOTHING, 'air': 1.0}),
    'inflow and flapping doubled': Condition(**{**NOTHING, 'air': 2.0}),
    'wind 16 m/s': Condition(**{**NOTHING, 'wind': (16.0, 16.0), 'turbulence': 0.25, 'air': 1.0}),
    'turbulence 8 m/s': Condition(**{**NOTHING, 'wind': (8.0, 8.0), 'air': 1.0}),
    'spread 8 %': Condition(**{**NOTHING, 'spread': (0.08, 0.08)}),
    'mass, inertia, battery': Condition(**{**NOTHING, 'mismatch': 1.0}),
    'payload of 15 %': Condition(**{**NOTHING, 'payload': (0.15, 0.15)}),
    'rotor inertia 2e-5': Condition(**NOTHING, more={'rotor_inertia': 2e-5}),
    'aggressive, nothing else': Condition(SHARP, **NOTHING),
    'landings, no wind': Condition(HOPS, **NOTHING),
    'landings, wind 5 m/s': Condition(HOPS, **{**NOTHING, 'wind': (5.0, 5.0), 'air': 1.0}),
}
"""Conditions of which one thing alone differs from the ideal."""

CONTACTS = {
    'landings in MuJoCo': replace(FLOWN['landings'], payload=(0.0, 0.0)),
}
"""Landings on the contacts of MuJoCo."""

LOSSES = {
    'total': {'failure': FAILURES['loss'], 'left': 0.0},
    '50 %': {'failure': FAILURES['loss'], 'left': 0.5},
    '30 %': {'failure': FAILURES['loss'], 'left': 0.7},
    'fade': {'failure': FAILURES['fade'], 'left': 0.0},
    'stuck': {'failure': FAILURES['stuck'], 'left': 1.0},
}
"""Failures: all thrust, half, 30 % of it, all within 2 s, and a rotor that keeps its speed."""
