# SPDX-License-Identifier: Apache-2.0
"""A thermal test profile as plain values: limits, steps, stabilisation, safe state, recording."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

STEP_KINDS = ('precondition', 'ramp', 'dwell', 'final', 'operator')
OPERATOR_PHASE = 'operator'
"""Phase of operator steps; not a phase of recordings."""


@dataclass(frozen=True)
class Stabilisation:
    """Criterion of a stabilised temperature: the dwell begins when it is met."""

    source: str = 'air'
    """Temperature it applies to: 'air', or 'device' = 'thermocouple' (on the device)."""
    band_c: float = 2.0
    """Largest distance from the set-point [K]."""
    hold_s: float = 0.0
    """How long it must stay in the band [s]."""
    max_rate_c_per_min: float | None = None
    """Largest mean rate over `rate_window_s` [K/min]; None: any."""
    rate_window_s: float = 300.0
    timeout_s: float = 3600.0
    on_timeout: str = 'abort'
    """'abort' (safe state), 'hold' (wait for the operator) or 'continue' (dwell anyway)."""


@dataclass(frozen=True)
class ProfileLimits:
    """Temperatures and rate allowed; those of the air are programmed into the chamber too."""

    air_min_c: float
    air_max_c: float
    rate_max_c_per_min: float
    device_min_c: float = -40.0
    device_max_c: float = 85.0


@dataclass(frozen=True)
class OnAbort:
    """The safe state: its temperature, the rate of the ramp to it, and the time allowed."""

    target_c: float = 20.0
    rate_c_per_min: float = 2.0
    timeout_s: float = 1800.0
    """Time allowed beyond the ramp itself [s]."""


@dataclass(frozen=True)
class Step:
    """One step of an unrolled profile: ramp to a temperature, stabilise, dwell."""

    id: str
    kind: str
    """One of STEP_KINDS."""
    target_c: float
    rate_c_per_min: float
    """Rate of the set-point towards the target [°C/min]."""
    dwell_s: float = 0.0
    dwell_mode: str = 'guaranteed'
    """Dwell clock out of the band: 'free' runs on, 'guaranteed' stops, 'restart' begins anew."""
    stabilise: Stabilisation | None = None
    prompt: str = ''
    expected_s: float = 0.0
    """Expected duration of an operator step; simulations confirm after it [s]."""
    phase: str = ''
    cycle: int = 0
    """1 … within the cycles, 0 outside."""
    orientation: str = ''
    """Sensor axis that points up, '+x' … '-z'; '' where not stated and in operator steps."""

    def ramp_s(self, from_c: float) -> float:
        """Return the time of the set-point's ramp from a temperature to the target [s]."""
        return abs(self.target_c - from_c) / self.rate_c_per_min * 60.0

    @property
    def hold_s(self) -> float:
        """Ideal time at the target: the dwell, or the expected time of an operator [s]."""
        return self.expected_s if self.kind == 'operator' else self.dwell_s


@dataclass(frozen=True)
class Record:
    """Settings of the recording of a run."""

    topics: tuple[str, ...] = ()
    """Topics to record; empty: all."""
    split: str = 'phase'
    chamber_period_s: float = 1.0
    """Period of the chamber's topics [s]."""


@dataclass(frozen=True)
class Profile:
    """A thermal test profile; `unroll.campaign_steps` gives the steps of all orientations."""

    name: str
    limits: ProfileLimits
    run_steps: tuple[Step, ...]
    """Steps of the run of one orientation, cycles unrolled."""
    on_abort: OnAbort = OnAbort()
    ambient_c: float = 20.0
    """The chamber may be opened at or above [°C]."""
    orientations: tuple[str, ...] = ()
    """Signed axes that point up, one run each; empty: one run, orientation not stated."""
    record: Record = Record()
    description: str = ''
    norm: str = ''
    text: str = field(default='', compare=False, repr=False)
    """The YAML text the profile was read from."""
    source: str = field(default='', compare=False)

    @property
    def sha256(self) -> str:
        """Hash of the file's text, which identifies the profile in journal and recording."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def start_c(self) -> float:
        """Temperature the first step goes to [°C]."""
        return self.run_steps[0].target_c
