# SPDX-License-Identifier: Apache-2.0
"""A grown model: what was added to it, and what each step did to the held-out error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from thermal_comp.comparison.compare import Comparison, SensorComparison, compare_prepared, rms_of
from thermal_comp.comparison.simpler import LEAST_SURE_RISE, raised, residual_ratios
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.improvement import falls, parts_that_fall
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.diagnose import base_effects
from thermal_comp.diagnosis.result import Diagnosis, Prediction
from thermal_comp.diagnosis.sensor_search import Listed
from thermal_comp.effects.effect import Effect, joined_effects
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.inputs import usable_sensors
from thermal_comp.fitting.weights import with_best_weights
from thermal_comp.model.values import NoiseModel, Provenance, ThermalModel, fitted_shapes
from thermal_comp.noise.of_runs import determined_noise
from thermal_comp.presentation.notebook import Presented


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added; rms over the sensors' axes, held out, in the sensor's unit."""

    added: str
    """Names, with + between several; '' where effects were only left out."""
    sensors: tuple[Sensor, ...]
    error_before: float
    error_after: float
    noise_floor: float
    ambiguous_with: tuple[str, ...] = ()
    empirical: bool = False
    """Whether no cause is decided: what was added only lowers the error on held-out parts."""
    lowered: bool = True
    """Whether the held-out error falls by more than chance."""
    parts: int = 0
    """Parts that were held out in turn."""
    parts_lowered: int = 0
    """Those of them whose error falls."""
    replaced: tuple[str, ...] = ()
    """Effects that were left out for it."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'added': self.added,
            'sensor': '+'.join(self.sensors),
            'error_before': self.error_before,
            'error_after': self.error_after,
            'noise_floor': self.noise_floor,
            'ambiguous_with': list(self.ambiguous_with),
            'empirical': self.empirical,
            'lowered': self.lowered,
            'parts': self.parts,
            'parts_lowered': self.parts_lowered,
            'replaced': list(self.replaced),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Growth(Presented):
    """A grown model and how it came about."""

    presentation = 'growth'

    model: ThermalModel
    before: Comparison
    after: Comparison
    steps: tuple[Step, ...]
    unneeded: tuple[str, ...] = ()
    """`sensor: effect` of terms the others make superfluous."""
    worse: tuple[str, ...] = ()
    """Where a line, or no model at all, leaves less on held-out parts."""
    diagnosis: Diagnosis | None = None
    """What is said about the grown model; None where it was not asked for."""

    @property
    def predictions(self) -> tuple[Prediction, ...]:
        """What the grown model leaves of each sensor's error."""
        made = []
        for sensor, before in self.before.sensors.items():
            after = self.after.sensors[sensor]
            steps = [step for step in self.steps if sensor in step.sensors]
            terms: list[str] = []
            for step in steps:
                terms = [name for name in terms if name not in step.replaced]
                terms += step.added.split(' + ') if step.added else []
            made.append(
                Prediction(
                    sensor,
                    tuple(terms),
                    rms_of(before.held_out_rms),
                    rms_of(after.held_out_rms),
                    rms_of(after.noise_floor),
                    any(step.empirical for step in steps),
                )
            )
        return tuple(made)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: the comparison after growing, and the steps to it."""
        return self.after.to_dict() | {
            'steps': [step.to_dict() for step in self.steps],
            'prediction': {p.sensor: p.to_dict() for p in self.predictions},
            'parameters': fitted_shapes(self.model),
            'unneeded': list(self.unneeded),
            'worse': list(self.worse),
            'undetermined': list(self.model.provenance.notes),
        }


def effects_by_sensor(runs: Sequence[PreparedRun], model: ThermalModel | None) -> Listed:
    """Return the effects of each sensor that can be fitted; without a model a line per axis."""
    return base_effects(model, usable_sensors(runs)[0])


def noise_by_sensor(
    runs: Sequence[PreparedRun], model: ThermalModel | None
) -> dict[Sensor, NoiseModel]:
    """Return the noise of the sensors beside their effects, where it can be told, and weights."""
    listed = effects_by_sensor(runs, model)
    return with_best_weights(runs, listed, determined_noise(runs, listed)[0])


def with_effects(
    model: ThermalModel | None,
    runs: Sequence[PreparedRun],
    noise: Mapping[Sensor, NoiseModel],
    listed: Listed,
    chosen: Mapping[Sensor, Sequence[Effect]],
    ambiguous_with: tuple[str, ...] = (),
    *,
    kept: Listed | None = None,
    empirical: bool = False,
) -> Growth:
    """Return the model with the chosen effects; `empirical`: a step a sensor, shapes stand.

    They stand beside those `kept`, or beside all.
    """
    stay = {
        s: (kept or {}).get(s, effects) if s in chosen else effects
        for s, effects in listed.items()
    }
    new: Listed = {
        s: joined_effects([*effects, *chosen.get(s, ())]) for s, effects in stay.items()
    }
    plain = fit_prepared(listed, runs, noise=noise, refine=False)
    grown = fit_prepared(new, runs, noise=noise, refine=not empirical)
    after = compare_prepared(grown, runs)
    before = compare_prepared(plain, runs, noise=noise)
    taken = {s: [e.name for e in effects[len(stay[s]) :]] for s, effects in listed.items()}
    put = {s: [e.name for e in effects] for s, effects in chosen.items()}
    names = {s: ' + '.join(n for n in own if n not in taken[s]) for s, own in put.items()}
    replaced = {s: tuple(n for n in taken[s] if n not in own) for s, own in put.items()}
    if empirical:
        grown = replace(grown, provenance=_with_note(grown.provenance, names))
    groups = [(s,) for s in chosen] if empirical else [tuple(chosen)]
    steps = tuple(
        _step_of(
            before.sensors[g[0]],
            after.sensors[g[0]],
            names[g[0]],
            g,
            ambiguous_with,
            empirical,
            replaced[g[0]],
        )
        for g in groups
    )
    return Growth(
        model=(model or plain).succeeded_by(grown), before=before, after=after, steps=steps
    )


def _step_of(
    before: SensorComparison,
    after: SensorComparison,
    added: str,
    sensors: tuple[Sensor, ...],
    ambiguous_with: tuple[str, ...],
    empirical: bool,
    replaced: tuple[str, ...],
) -> Step:
    """Return the step the held-out error takes on the first of the sensors."""
    squares = before.held_out_squares, after.held_out_squares, after.noise_floor**2
    return Step(
        added=added,
        sensors=sensors,
        error_before=rms_of(before.held_out_rms),
        error_after=rms_of(after.held_out_rms),
        noise_floor=rms_of(after.noise_floor),
        ambiguous_with=ambiguous_with,
        empirical=empirical,
        lowered=falls(*squares),
        parts=len(after.held_out_squares),
        parts_lowered=parts_that_fall(*squares),
        replaced=replaced,
    )


def _with_note(provenance: Provenance, names: Mapping[Sensor, str]) -> Provenance:
    """Return the provenance with a note on what was added without a cause."""
    notes = (
        f'{s}: {added} lowers the held-out error; cause undecided'
        for s, added in names.items()
        if added
    )
    return replace(provenance, notes=(*provenance.notes, *notes))


def error_rises(grown: Growth, sensors: Sequence[Sensor]) -> bool:
    """Tell whether the held-out error rises in all sensors, or on an axis by what is no chance.

    Or whether clearly more is left of an axis than was measured.
    """
    pairs = [(grown.before.sensors[s], grown.after.sensors[s]) for s in sensors]
    axes = (after.held_out_rms > LEAST_SURE_RISE * before.held_out_rms for before, after in pairs)
    worse = [residual_ratios(after) > LEAST_SURE_RISE for _, after in pairs]
    rising = any(axis.any() for axis in (*axes, *worse))
    return rising or all(raised(*pair) for pair in pairs)
