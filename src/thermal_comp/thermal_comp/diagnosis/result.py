# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis says: a verdict, findings in the order to act on, and each sensor's state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from thermal_comp.data.conditions import Sensor
from thermal_comp.effects.effect import Effect
from thermal_comp.presentation.notebook import Presented

SCHEMA = 2


@dataclass(frozen=True)
class Finding:
    """One thing to act on."""

    kind: str
    """effect, changed, clock, data_quality, noise, unexplained or unlogged."""
    name: str | None
    sensor: str
    evidence: float
    """2 ln of the Bayes factor."""
    threshold: float = 0.0
    probability: float | None = None
    """Probability that it acts; None for what is counted, not inferred."""
    ambiguous_with: tuple[str, ...] = ()
    depends_on: str | None = None
    error_before: float | None = None
    """Held-out rms over the sensor's axes, block means [unit]."""
    error_after: float | None = None
    noise_floor: float | None = None
    unit: str = ''
    rivals: tuple[Mapping[str, Any], ...] = ()
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    text: str = ''
    """The finding in a sentence."""

    @property
    def verdict(self) -> str:
        """The verdict this finding alone leads to."""
        if self.kind == 'effect':
            return 'ambiguous' if self.ambiguous_with else 'missing'
        return 'noise_above_reference' if self.kind == 'noise' else self.kind

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'kind': self.kind,
            'name': self.name,
            'sensor': self.sensor,
            'ambiguous_with': list(self.ambiguous_with),
            'depends_on': self.depends_on,
            'evidence': self.evidence,
            'threshold': self.threshold,
            'probability': self.probability,
            'error_before': self.error_before,
            'error_after': self.error_after,
            'noise_floor': self.noise_floor,
            'unit': self.unit,
            'rivals': [dict(rival) for rival in self.rivals],
            'parameters': {name: dict(value) for name, value in self.parameters.items()},
            'text': self.text,
        }


@dataclass(frozen=True)
class NamedExplanation:
    """One explanation of a sensor's residual: a set of effects, nothing, or something else."""

    names: tuple[str, ...]
    """Names of its effects, () for nothing; a cause without a name stands last, as
    `not_in_catalogue` or `unlogged`."""
    sensor: str
    probability: float
    approximate: bool
    """Whether an equation is probably not the whole of what its effect does."""
    depends_on: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'names': list(self.names) or ['nothing'],
            'sensor': self.sensor,
            'probability': self.probability,
            'approximate': self.approximate,
            'depends_on': self.depends_on,
        }


@dataclass(frozen=True)
class Prediction:
    """What a correction of one sensor leaves, held out; rms over the axes [SI]."""

    sensor: str
    terms: tuple[str, ...]
    """Effects beyond the model that was diagnosed."""
    error_before: float
    error_after: float
    noise_floor: float
    empirical: bool
    """Whether the cause is undecided: the terms only lower the error."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values; the sensor is the key it stands under."""
        return {
            'terms': list(self.terms),
            'error_before': self.error_before,
            'error_after': self.error_after,
            'noise_floor': self.noise_floor,
            'empirical': self.empirical,
        }


@dataclass(frozen=True)
class SensorState:
    """One sensor under the model that was diagnosed; rms per axis in its SI unit."""

    verdict: str
    residual_rms: tuple[float, ...]
    held_out_rms: tuple[float, ...]
    noise_floor: tuple[float, ...]
    unit: str
    where: tuple[Mapping[str, Any], ...] = ()
    smallest_found: Mapping[str, float] = field(default_factory=dict)
    """Rms of its error from which an effect would have been found, about, by effect, where none is
    missing."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'verdict': self.verdict,
            'unit': self.unit,
            'residual_rms': list(self.residual_rms),
            'held_out_rms': list(self.held_out_rms),
            'noise_floor': list(self.noise_floor),
            'where': [dict(where) for where in self.where],
            'smallest_found': dict(self.smallest_found),
        }


@dataclass(frozen=True)
class Undecided:
    """What these runs cannot tell apart, why, and what would."""

    between: tuple[str, ...]
    sensors: tuple[str, ...]
    similarity: float
    """Share of one effect's χ² that another would take over."""
    reason: str
    action: str

    @property
    def text(self) -> str:
        """Everything in a sentence."""
        names = ' or '.join(self.between)
        alike = f' ({self.similarity:.0%} alike)' if self.similarity < 1.0 else ''
        return f'{", ".join(self.sensors)}: {names}{alike}: {self.reason}; {self.action}'

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'between': list(self.between),
            'sensors': list(self.sensors),
            'similarity': self.similarity,
            'reason': self.reason,
            'action': self.action,
            'text': self.text,
        }


@dataclass(frozen=True, eq=False)
class RankedEffect:
    """One effect that was weighed against a sensor's residual."""

    sensor: Sensor
    effect: Effect
    """The form that explains most, beside the effects it is named with, else by itself."""
    probability: float
    """Probability that it acts: that of all explanations with it."""
    log_odds: float
    """ln of the odds of this effect alone to nothing at all, prior and evidence."""

    @property
    def name(self) -> str:
        """Catalogue name."""
        return self.effect.name


@dataclass(frozen=True, repr=False)
class Diagnosis(Presented):
    """The answer of `diagnose`."""

    presentation = 'diagnosis'

    device: str
    findings: tuple[Finding, ...]
    sensors: Mapping[str, SensorState]
    greyed_out: Mapping[str, str]
    """Effects that could not be tried, with the reason."""
    undetermined: tuple[str, ...] = ()
    """Directions of the model that these runs cannot tell."""
    notes: tuple[str, ...] = ()
    undecided: tuple[Undecided, ...] = ()
    """Pairs of effects that these runs cannot tell apart."""
    explanations: tuple[NamedExplanation, ...] = ()
    """Per sensor the fewest explanations that hold 95 % together, most probable first."""
    predictions: tuple[Prediction, ...] = ()
    """Errors that a correction with the named effects would leave, or with the closest ones where
    nothing is named."""
    ranking: tuple[RankedEffect, ...] = ()
    """Every effect that was weighed, for figures; not in `to_dict`."""

    @property
    def verdict(self) -> str:
        """Defects of the data first, else the strongest finding's."""
        if any(f.kind == 'data_quality' and f.name != 'startup_transient' for f in self.findings):
            return 'data_quality'
        physical = [f for f in self.findings if f.kind not in {'data_quality', 'noise', 'clock'}]
        others = [f for f in self.findings if f.kind == 'noise']
        return next((f.verdict for f in [*physical, *others]), 'complete')

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, schema 2."""
        return {
            'schema': SCHEMA,
            'device': self.device,
            'verdict': self.verdict,
            'findings': [finding.to_dict() for finding in self.findings],
            'explanations': [explanation.to_dict() for explanation in self.explanations],
            'prediction': {one.sensor: one.to_dict() for one in self.predictions},
            'sensors': {name: state.to_dict() for name, state in self.sensors.items()},
            'greyed_out': dict(self.greyed_out),
            'undetermined': list(self.undetermined),
            'undecided': [pair.to_dict() for pair in self.undecided],
            'notes': list(self.notes),
        }
