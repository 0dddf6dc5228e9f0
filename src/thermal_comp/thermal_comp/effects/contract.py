# SPDX-License-Identifier: Apache-2.0
"""The contract of an effect: finite causal columns of one shape, equal wherever a stream is cut.

What it declares about its search and about other effects has to be consistent, too.
"""

from __future__ import annotations

import traceback
from collections.abc import Collection
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import CHANNELS, SENSORS, Conditions, Sensor
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.c_form import CForm, CFormError, Signals
from thermal_comp.effects.effect import Campaign, Effect, Kin, State

EXAMPLE_ROWS = 600
CUT_ROWS = ((1,), (7, 8, 300), (150, 151, 599), tuple(range(50, 600, 50)))
"""Rows at which the example is cut into pieces."""
RELATIONS = ('look_alikes', 'separated_by_cycles')
"""Attributes that name other effects."""
FLAGS = (
    'coupled',
    'per_run',
    'searched',
    'temperature_coefficient',
    'names_cause',
    'bends',
    'first_order',
    'repeatable',
    'temperature_only',
    'time_only',
)
"""Attributes that are True or False."""
LARGEST_GROWTH_RATIO = 20.0
"""Ratio of columns at a hundred and at ten times a temperature above which an effect bends."""
USER_MODULES = 'user_effects_'
"""Prefix of the names of modules that are read from files of a user's effects."""
EXPLAINED_BY = ('mechanism', 'separation', 'typical_size', 'reference')
"""Texts that an effect of the catalogue has."""
EXAMPLE_CAMPAIGN = Campaign(
    cycles=4,
    durations=(40_000.0,) * 3,
    times_before=(0.0, 60_000.0, 120_000.0),
    spectral_lines=lambda: [(0.0123, 0.0), (0.0123, 2e-5)],
    step_times=lambda: [(1, 20_000.0, 0.0)],
    channels=frozenset(CHANNELS),
)
"""An example of the runs that a search chooses forms for."""


def check_effect(
    effect: type[Effect], known: Collection[str] = EFFECTS, *, explained: bool = False
) -> list[str]:
    """Return what breaks the contract, one sentence each; empty where the effect keeps it.

    `known` are the effects it may name; `explained` asks for the texts `explain` prints, as the
    catalogue does of its own effects.

    >>> check_effect(EFFECTS['thermal_lag'], explained=True)
    []
    """
    problems = (
        _problems_of_the_description(effect)
        + _problems_of_the_relations(effect, known)
        + _problems_of_the_hints(effect)
    )
    if explained:
        problems += [f'{text} is empty' for text in EXPLAINED_BY if not getattr(effect, text)]
    if not problems:
        try:
            instance = effect()
            problems += _problems_of_the_shape(instance) + _problems_of_the_search(effect)
            problems += _problems_of_the_guess(effect)
            for sensor in effect.sensors:
                problems += _problems_of_the_columns(instance, sensor)
        except (Exception, SystemExit) as error:  # noqa: BLE001 (whatever the effect's own code does)
            problems.append(f'raises {type(error).__name__}: {error}{line_of(error)}')
    return [f'{effect.name or effect.__name__}: {problem}' for problem in problems]


def line_of(error: BaseException) -> str:
    """Return ' (file.py, line 3)': the last line of a user's effect on the way to an error.

    '' where none is on the way.
    """
    walked = traceback.walk_tb(error.__traceback__)
    lines = [
        (frame.f_code.co_filename, line)
        for frame, line in walked
        if str(frame.f_globals.get('__name__', '')).startswith(USER_MODULES)
    ]
    return f' ({Path(lines[-1][0]).name}, line {lines[-1][1]})' if lines else ''


def example_conditions(seed: int = 0, sensor: Sensor = 'accelerometer') -> Conditions:
    """Return irregularly sampled conditions of a short cycle in which every channel is present."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.2, 40.0, EXAMPLE_ROWS)) + 100.0
    swing = np.sin(2.0 * np.pi * np.arange(EXAMPLE_ROWS) / 300.0)
    up = np.array([0.3, -0.2, 9.8])
    field = np.array([1.8e-5, 0.6e-5, -4.0e-5])
    switch = (rng.random(EXAMPLE_ROWS) > 0.5).astype(float)
    return Conditions(
        time=time,
        temperature=20.0 + 30.0 * swing + rng.normal(0.0, 0.05, EXAMPLE_ROWS),
        specific_force=up + rng.normal(0.0, 0.1, (EXAMPLE_ROWS, 3)),
        angular_velocity=rng.normal(0.0, 0.1, (EXAMPLE_ROWS, 3)),
        magnetic_field=np.tile(field, (EXAMPLE_ROWS, 1)),
        sensor=sensor,
        orientation=np.eye(3)[[1, 2, 0]],
        chamber_temperature=20.0 + 32.0 * swing,
        chamber_temperature_2=20.0 + 33.0 * swing,
        device_temperature=20.0 + 31.0 * swing,
        humidity=0.5 + 0.2 * swing,
        pressure=101_325.0 + rng.normal(0.0, 100.0, EXAMPLE_ROWS),
        heater=switch,
        compressor=1.0 - switch,
        fan=np.ones(EXAMPLE_ROWS),
        supply_voltage=3.3 + rng.normal(0.0, 0.01, EXAMPLE_ROWS),
        vibration=rng.uniform(0.0, 0.1, (EXAMPLE_ROWS, 3)),
        setpoint=20.0 + 30.0 * swing,
        phase=np.full(EXAMPLE_ROWS, 3, dtype=np.int64),
        cycle=1 + np.arange(EXAMPLE_ROWS, dtype=np.int64) // 200,
    )


def columns_in_pieces(effect: Effect, conditions: Conditions, cuts: tuple[int, ...]) -> FloatArray:
    """Return the columns computed piece by piece, the history carried from one to the next."""
    state: State | None = None
    pieces = []
    for start, stop in zip((0, *cuts), (*cuts, len(conditions)), strict=True):
        columns, state = effect.columns(conditions.rows(slice(start, stop)), state)
        pieces.append(columns)
    return np.concatenate(pieces)


def _problems_of_the_description(effect: type[Effect]) -> list[str]:
    problems = []
    problems += [f'{text} is empty' for text in ('name', 'equation') if not getattr(effect, text)]
    if not is_dataclass(effect) or not effect.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        problems.append('is not a frozen dataclass')
    if 'error' not in effect.equation:
        problems.append('equation does not say what the error is')
    if not effect.coefficient_units:
        problems.append('coefficient_units is empty')
    symbols, units = len(effect.coefficient_symbols), len(effect.coefficient_units)
    if symbols not in (0, units):
        problems.append(f'{units} coefficient_units, but {symbols} coefficient_symbols')
    known = {*CHANNELS, 'orientation'}
    named = (*effect.channels, *effect.substitutes)
    problems += [f'channel {c!r} is none of {sorted(known)}' for c in named if c not in known]
    if effect.substitutes and len(effect.channels) != 1:
        problems.append('has substitutes, but not one channel that they stand in place of')
    problems += [f'sensor {s!r} is none of {SENSORS}' for s in effect.sensors if s not in SENSORS]
    for item in fields(effect):
        unit, bounds = item.metadata.get('unit'), item.metadata.get('bounds')
        if not unit or not bounds:
            problems.append(f'{item.name} has no unit or bounds: declare it by shape_parameter')
        elif not _within(item.default, bounds):
            problems.append(f'{item.name}: default {item.default} is outside {bounds}')
    return problems


def _within(value: Any, bounds: tuple[float, float]) -> bool:
    return bool(np.all((bounds[0] <= np.array(value)) & (np.array(value) <= bounds[1])))


def _problems_of_the_relations(effect: type[Effect], known: Collection[str]) -> list[str]:
    """Return what is inconsistent in what an effect declares about others."""
    problems = []
    named: dict[str, tuple[str, ...]] = {r: getattr(effect, r) for r in RELATIONS}
    named['twin'] = (effect.twin,) if effect.twin else ()
    for relation, names in named.items():
        if not isinstance(names, tuple):
            problems.append(f'{relation} is no tuple of names: {names!r}')
            continue
        unknown = [n for n in names if n == effect.name or n not in known]
        problems += [f'{relation}: {n!r} is no other effect that is known' for n in unknown]
    if effect.kin not in get_args(Kin):
        problems.append(f'kin {effect.kin!r} is none of {get_args(Kin)}')
    if not set(effect.separated_by_poses) <= set(effect.sensors):
        problems.append('separated_by_poses names a sensor it does not act on')
    if effect.coupled and len(effect.sensors) < 2:
        problems.append('is coupled, but acts on one sensor')
    return problems


def _problems_of_the_hints(effect: type[Effect]) -> list[str]:
    """Return attributes of search and diagnosis that have impossible values."""
    problems = [
        f'{flag} is {getattr(effect, flag)!r}, expected True or False'
        for flag in FLAGS
        if not isinstance(getattr(effect, flag), bool)
    ]
    ratio = effect.least_ratio
    if not isinstance(ratio, int | float) or not 0.0 <= ratio < np.inf:
        problems.append(f'least_ratio is {ratio!r}, expected a number from 0 on')
    if not isinstance(effect.separating_action, str):
        problems.append(f'separating_action is {effect.separating_action!r}, expected a text')
    guessed = effect.guessed_channel
    if guessed and guessed not in CHANNELS:
        problems.append(f'guessed_channel {guessed!r} is none of {sorted(CHANNELS)}')
    if guessed and guessed in effect.channels:
        problems.append(f'guessed_channel {guessed!r} is among the channels it needs, too')
    if effect.first_order is True and not any(
        f.metadata.get('unit') == 's' for f in fields(effect)
    ):
        problems.append('is first_order, but has no time constant: no shape parameter in s')
    return problems


def _problems_of_the_guess(effect: type[Effect]) -> list[str]:
    """Return what is wrong with the effect that stands in where a channel was not logged."""
    guess = effect.guess()
    if guess is None:
        return []
    if not (isinstance(guess, type) and issubclass(guess, Effect)):
        return [f'guess gives {guess!r}, expected the class of an effect']
    channel = guess.guessed_channel
    if channel in effect.channels:
        return []
    return [f'guess: {guess.name} guesses the channel {channel!r}, which is none of its channels']


def _problems_of_the_search(effect: type[Effect]) -> list[str]:
    """Every form a search tries is the effect within its bounds; its parts make up its columns."""
    tried = effect.search_grid(EXAMPLE_CAMPAIGN) if effect.searched else []
    forms = [*(candidate.effect for candidate in tried), *effect.sample_forms()]
    if effect.searched and not tried:
        return ['search_grid has no form for runs of four cycles']
    if any(type(form) is not effect for form in forms):
        return ['search_grid or sample_forms has a form that is another effect']
    for form in forms:
        for item in fields(form):
            if not _within(getattr(form, item.name), item.metadata['bounds']):
                return [f'search: {item.name} {getattr(form, item.name)} is outside its bounds']
    for candidate in tried:
        if candidate.run is not None and not (
            effect.per_run and 0 <= candidate.run < len(EXAMPLE_CAMPAIGN.durations)
        ):
            return [f'search_grid: run {candidate.run} needs coefficients per run, and the run']
    conditions = example_conditions(sensor=effect.sensors[0])
    for form in forms:
        parts = [part.columns(conditions)[0] for part in form.parts()]
        if not np.array_equal(np.concatenate(parts, axis=-1), form.columns(conditions)[0]):
            return ['parts: their columns beside each other are not its own']
    return []


def _problems_of_the_shape(effect: Effect) -> list[str]:
    """Return what is wrong with one form of the effect, whatever the conditions are."""
    same = replace(effect)
    problems = []
    if same != effect or hash(same) != hash(effect):
        problems.append('two equal ones differ')
    if effect.live_forms()[:1] != (effect,):
        problems.append('live_forms: the first is not the form itself')
    if effect.repeatable and not effect.occurrences:
        problems.append('is repeatable, but occurrences is empty')
    frequency = effect.line_frequency
    if frequency is not None and not 0.0 <= frequency < np.inf:
        problems.append(f'line_frequency is {frequency}, expected None or a number from 0 on [Hz]')
    return problems


def _problems_of_the_columns(effect: Effect, sensor: Sensor) -> list[str]:
    conditions = example_conditions(sensor=sensor)
    whole, _ = effect.columns(conditions, None)
    problems = []
    rows = EXAMPLE_ROWS
    if whole.ndim not in {2, 3} or len(whole) != rows or (whole.ndim == 3 and whole.shape[1] != 3):
        return [f'columns have shape {whole.shape}, expected ({rows}, p) or ({rows}, 3, p)']
    if not np.isfinite(whole).all():
        problems.append(f'columns for the {sensor} are not finite')
    tolerance = 1e-9 * max(float(np.abs(whole).max()), 1e-300)
    for cuts in CUT_ROWS:
        try:
            pieces = columns_in_pieces(effect, conditions, cuts)
        except (ValueError, IndexError, TypeError) as error:
            problems.append(f'fails when the stream is cut at {cuts[:3]}: {error}')
            break
        if pieces.shape != whole.shape or np.abs(pieces - whole).max() > tolerance:
            problems.append(
                f'columns for the {sensor} change when the stream is cut at {cuts[:3]}'
            )
            break
    problems += _problems_of_the_c_form(effect, sensor, whole)
    hindsight = effect.columns_in_hindsight(conditions)
    if np.shape(hindsight) != whole.shape:
        problems.append(
            f'columns_in_hindsight have shape {np.shape(hindsight)}, columns {whole.shape}'
        )
    else:
        problems += _problems_of_hindsight(effect, conditions)
    deviations = effect.coefficient_deviations()
    if deviations is not None and np.shape(deviations) != (whole.shape[-1], 3):
        problems.append(
            f'coefficient_deviations have shape {np.shape(deviations)}, '
            f'expected ({whole.shape[-1]}, 3)'
        )
    return [
        *problems,
        *_problems_without_channels(effect, conditions),
        *_problems_far_out(effect),
        *_problems_of_temperature_alone(effect, conditions),
        *_problems_of_time_alone(effect, conditions),
    ]


def _problems_of_the_c_form(effect: Effect, sensor: Sensor, columns: FloatArray) -> list[str]:
    """Where there is a C form, it has as many columns, per axis or shared, as the effect."""
    form = CForm(sensor, Signals(), effect.name, effect.needs, held=effect.bends)
    try:
        made = effect.c_columns(form)
    except CFormError as error:
        return [f'c_columns: {error}']
    if made is None:
        return []
    found = len(made.expressions) if made.mixing is None else made.mixing.shape[1]
    if found != columns.shape[-1]:
        return [f'c_columns gives {found} columns, columns {columns.shape[-1]}']
    alike = all(isinstance(e, str) == (columns.ndim == 2) for e in made.expressions)
    return (
        [] if alike else ['c_columns: write three expressions where the axes share coefficients']
    )


def _problems_far_out(effect: Effect) -> list[str]:
    """Columns must not grow faster than the temperature, unless the effect bends."""
    if effect.bends:
        return []
    seen = example_conditions(sensor=effect.sensors[0])
    hot = (replace(seen, temperature=k * seen.temperature) for k in (10.0, 100.0))
    near, far = (np.abs(effect.columns(conditions)[0]).max(axis=0) for conditions in hot)
    return (
        ['columns grow faster than in proportion to temperature: say bends = True']
        if not bool(np.all(far <= LARGEST_GROWTH_RATIO * near))
        else []
    )


def _problems_of_temperature_alone(effect: Effect, conditions: Conditions) -> list[str]:
    """Columns said to depend on the temperature alone are the same in another place and time."""
    if not effect.temperature_only:
        return []
    elsewhere = replace(
        conditions,
        time=conditions.time + 1e5,
        specific_force=2.0 - conditions.specific_force,
        angular_velocity=1.0 - conditions.angular_velocity,
        magnetic_field=1e-5 - conditions.magnetic_field,
    )
    columns, state = effect.columns(conditions)
    alike = state is None and np.array_equal(columns, effect.columns(elsewhere)[0])
    return [] if alike else ['columns depend on more than temperature_only says']


def _problems_of_time_alone(effect: Effect, conditions: Conditions) -> list[str]:
    """Columns said to depend on time alone are the same at another temperature."""
    if not effect.time_only:
        return []
    warmer = replace(conditions, temperature=40.0 - 0.5 * conditions.temperature)
    alike = np.array_equal(effect.columns(conditions)[0], effect.columns(warmer)[0])
    return [] if alike else ['columns depend on more than time_only says']


def _problems_of_hindsight(effect: Effect, conditions: Conditions) -> list[str]:
    """Return what is wrong with columns that a search tells forms apart by."""
    forms = [c.effect for c in type(effect).search_grid(EXAMPLE_CAMPAIGN)]
    if len(forms) < 2:
        return []
    first, last = forms[0], forms[-1]
    live = [form.columns(conditions)[0] for form in (first, last)]
    known = [form.columns_in_hindsight(conditions) for form in (first, last)]
    if np.array_equal(known[0], known[1]) and not np.array_equal(live[0], live[1]):
        problem = f'columns_in_hindsight are the same for {first!r} and {last!r}, columns are not'
        return [f'{problem}: a search could not tell them apart']
    return []


def _problems_without_channels(effect: Effect, conditions: Conditions) -> list[str]:
    """Columns must not depend on channels the effect does not declare."""
    used = {*effect.needs, *effect.optional_channels}
    absent: dict[str, Any] = dict.fromkeys({*CHANNELS, 'orientation'} - used)
    whole, _ = effect.columns(conditions, None)
    try:
        alone, _ = effect.columns(replace(conditions, **absent), None)
    except (AssertionError, AttributeError, TypeError) as error:
        return [f'needs a channel it does not declare: {error!r}']
    return (
        []
        if np.array_equal(alone, whole)
        else ['columns change with channels it does not declare']
    )
