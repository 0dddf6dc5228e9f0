# SPDX-License-Identifier: Apache-2.0
"""A physical effect: its columns, and what else search, diagnosis and reports know about it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from functools import cache, partial
from itertools import product
from typing import Any, ClassVar, Literal, Self

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import SENSORS, Conditions, Sensor
from thermal_comp.data.time_scale import LEAST_TIME_SCALE, time_scale
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.resolution import example_cycle, refined, thinned

State = Any
"""History an effect carries from one piece of a stream to the next: a tuple of plain numbers."""
Kin = Literal['', 'temperature', 'orientation', 'time']
"""Groups of effects, by what their errors follow."""
FLIP_ACTION = 'flip: add a run with one axis pointing down'
"""Action that separates effects that turn with the device from effects that do not."""
COUNT_UNIT = '1'
"""Unit of a parameter that is a number or a choice: part of the form, not searched or fitted."""


def shape_parameter(
    default: float | tuple[float, ...],
    *,
    unit: str,
    bounds: tuple[float, float],
    searched: tuple[float, float] | None = None,
    step: float | None = None,
    given: bool = False,
    assumed: bool = False,
) -> Any:
    """Declare a nonlinear parameter of an effect: default, unit and bounds of every value.

    `searched` are bounds of the search where they are closer; of recordings of minutes times are
    shorter than either (`time_scale`). A search moves a value by a share
    of itself (a quarter first), or by `step` where zero means nothing: an instant, a frequency;
    by default where the bounds include negative values. `given` ones are part of the form,
    neither searched nor fitted, but for a choice among `live_forms`. `assumed`: a model file
    without it means the default.
    """
    if step is None and bounds[0] < 0.0:
        step = (bounds[1] - bounds[0]) / 32.0
    metadata = {
        'unit': unit,
        'bounds': bounds,
        'searched': searched,
        'step': step,
        'given': given or unit == COUNT_UNIT,
        'assumed': assumed,
    }
    return field(default=default, metadata=metadata)


def shape_bounds(
    item: Field[Any], scale: float = LEAST_TIME_SCALE, *, searched: bool = False
) -> tuple[float, float]:
    """Return the bounds of a shape parameter, or those within which it is searched.

    Times [s] are as short as `scale` allows (`time_scale`), by default that of any recording.
    """
    closer = item.metadata.get('searched') if searched else None
    low, high = closer or item.metadata.get('bounds', (-np.inf, np.inf))
    return (scale * low if item.metadata.get('unit') == 's' and low > 0.0 else low), high


@dataclass(frozen=True)
class Candidate:
    """A form of an effect that a search tries."""

    effect: Effect
    run: int | None = None
    """The run in which alone it acts, for an effect with coefficients per run; None: in all."""


@dataclass(frozen=True, eq=False)
class Campaign:
    """What a search knows of the runs when it chooses forms of an effect."""

    cycles: int
    """Thermal cycles of the run that has most."""
    durations: tuple[float, ...]
    """Time of each run's last block [s]."""
    times_before: tuple[float, ...]
    """Time from the start of the first run to that of each [s]."""
    spectral_lines: Callable[[], Sequence[tuple[float, float]]]
    """Frequency [Hz] and drift [Hz/K] of the most prominent lines, strongest first."""
    step_times: Callable[[], Sequence[tuple[int, float, float]]]
    """Run, time and duration [s] of the likeliest steps of the level."""
    channels: frozenset[str] = frozenset()
    """Channels that were logged in every run."""
    occurred: Sequence[tuple[int | None, float]] = ()
    """Run, None for all, and time [s] of known events: near one no other is looked for."""

    @property
    def time_scale(self) -> float:
        """Share of the usual times that those of these runs are."""
        return time_scale(max(self.durations))


@dataclass(frozen=True)
class Effect:
    """One physical effect: subclass as a frozen dataclass whose fields are shape parameters.

    The class attributes describe it; `explain` and doc/physics.md print them. Device effects
    belong to the sensor, are causal and are compensated in the field; campaign effects belong to
    chamber, fixture or session and are fitted only so that they do not spoil the coefficients.
    The attributes from `searched` on, and the methods after `columns`, are for search, diagnosis
    and the planning of experiments; their defaults suit most effects.
    """

    name: ClassVar[str] = ''
    """Catalogue key = key in the model file = label in reports."""
    kind: ClassVar[Literal['device', 'campaign']] = 'device'
    sensors: ClassVar[tuple[Sensor, ...]] = SENSORS
    """Sensors it can act on."""
    coupled: ClassVar[bool] = False
    """True where the sensors share one set of coefficients."""
    per_run: ClassVar[bool] = False
    """True where every run has coefficients of its own."""
    channels: ClassVar[tuple[str, ...]] = ()
    """Channels of Conditions it needs beyond time, die temperature and the true inputs."""
    substitutes: ClassVar[tuple[str, ...]] = ()
    """Channels of which any may stand in place of the one it needs; a form `needs` one of them."""
    optional_channels: ClassVar[tuple[str, ...]] = ()
    """Channels it makes use of where they were logged."""
    equation: ClassVar[str] = ''
    """error = …, with units."""
    coefficient_units: ClassVar[tuple[str, ...]] = ()
    """Unit of each column's coefficient, or one of all; {unit} stands for the sensor's SI unit."""
    coefficient_symbols: ClassVar[tuple[str, ...]] = ()
    """What the equation calls each column's coefficient, where there are several."""
    mechanism: ClassVar[str] = ''
    look_alikes: ClassVar[tuple[str, ...]] = ()
    separation: ClassVar[str] = ''
    """How to tell it from its look-alikes."""
    typical_size: ClassVar[str] = ''
    reference: ClassVar[str] = ''
    """Standard, datasheet or paper."""

    searched: ClassVar[bool] = True
    """False where it is part of every model, so that no diagnosis looks for it."""
    temperature_coefficient: ClassVar[bool] = False
    """True where its coefficient is that of the bias over temperature (TCO)."""
    names_cause: ClassVar[bool] = True
    """False where it follows whatever lowers the error: its cause is undecided."""
    bends: ClassVar[bool] = False
    """True where it grows faster than in proportion to temperature: outside the fitted ones it
    goes on with its slope at the edge."""
    first_order: ClassVar[bool] = False
    """True where it relaxes with one time constant; a real body may relax with several."""
    least_ratio: ClassVar[float] = 0.0
    """Least ratio of a shape parameter to the one before it, in searches and fits: two stages of
    nearly one time constant cannot be told from a single stage."""
    repeatable: ClassVar[bool] = False
    """True where it may occur more than once."""
    temperature_only: ClassVar[bool] = False
    """True where it depends on the sample's own die temperature alone: a compensator may keep its
    columns by temperature."""
    time_only: ClassVar[bool] = False
    """True where it depends on time alone, so that slow noise may look like it."""
    differentiates: ClassVar[bool] = False
    """True where it follows the derivative of the temperature, or a difference that is like it: it
    feels a thermometer that lags."""
    kin: ClassVar[Kin] = ''
    """Group of effects of which one may fit what the equation of another lacks."""
    twin: ClassVar[str] = ''
    """Effect with nearly the same columns: told from it by small differences, and not at all where
    that one's channel was not logged."""
    separated_by_cycles: ClassVar[tuple[str, ...]] = ()
    """Effects from which it is told only by a temperature that returns or has several rates."""
    separated_by_poses: ClassVar[tuple[Sensor, ...]] = ()
    """Sensors on which only other orientations tell it from a bias over temperature."""
    guessed_channel: ClassVar[str] = ''
    """Channel that it guesses from others: finding it says that this channel was not logged."""
    separating_action: ClassVar[str] = ''
    """Action that tells it from its rivals in an experiment, beside the temperature profile."""

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return the columns for the samples and the history for the samples after them.

        (n, p): each axis has its own p coefficients; (n, 3, p): p coefficients shared by the axes.
        `state` None starts the history at the first sample.
        """
        raise NotImplementedError

    def c_columns(self, c: CForm) -> CColumns | None:
        """Return the columns as expressions of C99 for one sensor; None where there is no C form.

        `c` holds the names and operators. `export --to c99` needs it of every device effect of a
        model; what stays in the chamber needs none.
        """
        return None

    def columns_in_hindsight(self, conditions: Conditions) -> FloatArray:
        """Return the columns of a whole run and its smoothed temperature, for a diagnosis.

        An effect that smooths or delays only to be causal overrides it.
        """
        return self.columns(conditions)[0]

    @classmethod
    def lacking(cls, logged: Collection[str]) -> list[str]:
        """Return the channels it needs that are not among those logged, nor a substitute."""
        if not set(logged).isdisjoint(cls.substitutes):
            return []
        return [channel for channel in cls.channels if channel not in logged]

    @property
    def needs(self) -> tuple[str, ...]:
        """Channels that this form needs."""
        return self.channels

    @property
    def occurrences(self) -> tuple[float, ...]:
        """Times at which it happens [s]; () where it is no event."""
        return ()

    def coefficient_deviations(self) -> FloatArray | None:
        """Return (p, 3) prior standard deviations of the coefficients [unit]; None: they are free.

        The prior is Gaussian about zero; every fit adds it to the normal equations.
        """
        return None

    def coefficient_labels(self, count: int) -> list[str]:
        """Return the labels of its coefficients: its name, with symbols where there are several.

        Those without a symbol are numbered.
        """
        if count == 1:
            return [self.name]
        numbered = [f'{number + 1} of {count}' for number in range(count)]
        symbols = self.coefficient_symbols
        return [f'{self.name}, {s}' for s in (symbols if len(symbols) == count else numbered)]

    def units_of_coefficients(self, count: int, unit: str) -> list[str]:
        """Return the units of so many coefficients on a sensor with that SI unit."""
        units = self.coefficient_units
        every = units if len(units) == count else (*units[:1],) * count or ('',) * count
        return [text.format(unit=unit) for text in every]

    @property
    def shape_parameters(self) -> dict[str, Any]:
        """Shape parameters by name, those that this form has."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @property
    def free_parameters(self) -> list[Field[Any]]:
        """Shape parameters that a search moves and a fit finds; others are part of the form."""
        known = self.shape_parameters
        return [f for f in fields(self) if f.name in known and not f.metadata.get('given', True)]

    @property
    def stages(self) -> FloatArray:
        """Return its (k,) free parameters, in their unit, if they are stages; else none."""
        some = [getattr(self, item.name) for item in self.free_parameters if self.least_ratio]
        return np.hstack([(), *some])

    @property
    def stages_are_apart(self) -> bool:
        """Whether each stage is `least_ratio` times the one before it."""
        stages = self.stages
        return bool((stages[1:] >= self.least_ratio * stages[:-1]).all())

    @property
    def variant(self) -> tuple[float, ...]:
        """Its numbers and choices: forms of one variant differ only in what a search moves."""
        known = self.shape_parameters
        numbers = [f.name for f in fields(self) if f.metadata.get('unit') == COUNT_UNIT]
        return tuple(
            known[name] for name in numbers if name in known and not isinstance(known[name], tuple)
        )

    @property
    def free_shapes(self) -> int:
        """Number of values among the shape parameters that a search chooses."""
        values = [getattr(self, item.name) for item in self.free_parameters]
        return sum(len(value) if isinstance(value, tuple) else 1 for value in values)

    @classmethod
    def shape_grid(cls, points: int = 9) -> list[Self]:
        """Return the effect on a grid of its shape parameters between their bounds.

        Geometric where a parameter is positive, else even.
        """
        forms = [cls()]
        for item in cls().free_parameters:
            low, high = item.metadata['bounds']
            if isinstance(item.default, tuple):
                continue
            even = low < 0.0
            values = (
                np.linspace(low, high, points)
                if even
                else np.geomspace(max(low, 1e-4 * high), high, points)
            )
            forms = [replace(form, **{item.name: float(v)}) for form in forms for v in values]
        return forms

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return the forms that a search over these runs tries first."""
        kind: Any = cls
        return [Candidate(form) for form in _resolved(kind)]

    @classmethod
    def sample_forms(cls) -> list[Self]:
        """Return a few forms, short to long or narrow to wide, for a quick comparison."""
        return cls.shape_grid(5)

    @classmethod
    def guess(cls) -> type[Effect] | None:
        """Return the effect with its channel guessed, for runs without it; None: it cannot be."""
        return None

    def live_forms(self) -> tuple[Self, ...]:
        """Return this form and others that only filter the thermometer's noise differently.

        A fit takes the one with the smallest error on held-out parts.
        """
        return (self,)

    def parts(self) -> tuple[Effect, ...]:
        """Return effects whose columns beside each other are this one's."""
        return (self,)

    @property
    def line_frequency(self) -> float | None:
        """Frequency of the spectral line that it is [Hz]; None where it is none."""
        return None

    @property
    def of_any_cause(self) -> bool:
        """Whether an error of any other cause may have exactly these columns."""
        return False

    def is_kin_of(self, other: Effect) -> bool:
        """Tell whether one may fit what the equation of the other lacks."""
        return self.kin != '' and self.kin == other.kin


@cache
def _resolved(effect: Any) -> tuple[Effect, ...]:
    """Return an effect on its grid of shapes, refined where neighbours have little in common."""
    conditions = example_cycle(effect.sensors[0])
    grid = effect.shape_grid()
    values: dict[str, list[float]] = {}
    for name, default in effect().shape_parameters.items():
        start = sorted({getattr(form, name) for form in grid})
        if not isinstance(default, tuple) and len(start) > 1:
            at = partial(_columns_at, effect(), name, conditions)
            values[name] = refined(start, at)
    kept = thinned(list(values.values()))
    return tuple(replace(effect(), **dict(zip(values, v, strict=True))) for v in product(*kept))


def _columns_at(effect: Effect, name: str, conditions: Conditions, value: float) -> FloatArray:
    shape: dict[str, Any] = {name: value}
    return replace(effect, **shape).columns(conditions)[0]


EDGE_STEP_K = 0.01
"""Step within a range over which a slope at its edge is taken [K]."""


def columns_from(
    effect: Effect, conditions: Conditions, span: tuple[float, float], state: State | None = None
) -> tuple[FloatArray, State | None]:
    """Return the columns of a model that was fitted within a span of temperature [°C].

    Outside the span effects that bend go on with their slope at its edge.
    """
    temperature = conditions.temperature
    held = np.minimum(np.maximum(temperature, span[0]), span[1])
    beyond = temperature - held
    if not effect.bends or not beyond.any():
        return effect.columns(conditions, state)
    within = held - EDGE_STEP_K * np.sign(beyond)
    at_edge, after = effect.columns(replace(conditions, temperature=held), state)
    inside, _ = effect.columns(replace(conditions, temperature=within), state)
    share = (np.abs(beyond) / EDGE_STEP_K).reshape(-1, *[1] * (at_edge.ndim - 1))
    return at_edge + share * (at_edge - inside), after


def joined_effects(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects with repeated ones joined: two steps are one effect of two step times.

    Values of one occurrence stay together: every step keeps its duration.
    """
    joined: dict[str, Effect] = {}
    for effect in effects:
        before = joined.get(effect.name)
        joined[effect.name] = _joined(before, effect) if before else effect
    return tuple(joined.values())


def _joined(one: Effect, other: Effect) -> Effect:
    names = [name for name, value in one.shape_parameters.items() if isinstance(value, tuple)]
    rows = {
        row
        for effect in (one, other)
        for row in zip(*(getattr(effect, name) for name in names), strict=True)
    }
    values: dict[str, Any] = dict(zip(names, zip(*sorted(rows), strict=True), strict=False))
    return replace(one, **values)
