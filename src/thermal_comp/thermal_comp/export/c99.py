# SPDX-License-Identifier: Apache-2.0
"""A thermal model as C99: one header, one source, no heap, the history in a struct."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from string import Template
from typing import get_args

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray

from thermal_comp.data.conditions import SENSORS, Sensor, settled_conditions
from thermal_comp.effects.c_form import CColumns, CForm, Kind, Signal, Signals
from thermal_comp.effects.effect import EDGE_STEP_K, Effect
from thermal_comp.model.file import model_label
from thermal_comp.model.values import ModelError, SensorModel, ThermalModel

C_FUNCTIONS = {
    'clip(': """
static imu_thermal_real clip(imu_thermal_real value, imu_thermal_real low, imu_thermal_real high)
{
  return value < low ? low : (value > high ? high : value);
}
""",
    'advance_lag(': """
/* output = lagged - value. Over a step h in units of the time constant, with the value linear:
 * output += (e^-h - 1) (output + change / h). `lost` holds what the sum loses to rounding. */
static void advance_lag(imu_thermal_lag *lag, imu_thermal_real value, imu_thermal_real step,
                        imu_thermal_real time_constant)
{
  if (lag->started) {
    const imu_thermal_real change = value - lag->input;
    const imu_thermal_real h = step / time_constant;
    const imu_thermal_real added = (h > REAL(0.0) ? EXPM1(-h) * (lag->output + change / h)
                                                  : -change) - lag->lost;
    const imu_thermal_real sum = lag->output + added;
    lag->lost = (sum - lag->output) - added;
    lag->output = sum;
  }
  lag->started = true;
  lag->input = value;
}
""",
    'advance_lag_difference(': """
/* output = second - first lag of a value, after a step in which the value is linear; `first` is
 * before it. With h = step / time constant and a = h1 - h2 its exact course is
 * e^-h2 output + (e^-h2 - e^-h1) first - change (e^-h1 - e^-h2 + a (1 - e^-h1) / h1) / h2. */
static void advance_lag_difference(imu_thermal_lag_difference *difference,
                                   const imu_thermal_lag *first, imu_thermal_real value,
                                   imu_thermal_real step, imu_thermal_real first_time_constant,
                                   imu_thermal_real second_time_constant, imu_thermal_real apart)
{
  if (first->started && step > REAL(0.0)) {
    const imu_thermal_real change = value - first->input;
    const imu_thermal_real h1 = step / first_time_constant;
    const imu_thermal_real h2 = step / second_time_constant;
    const imu_thermal_real decay = EXPM1(-h2);
    const imu_thermal_real more = (REAL(1.0) + decay) * EXPM1(-step * apart);
    const imu_thermal_real lead = (more - EXPM1(-h1) / h1 * step * apart) / h2;
    const imu_thermal_real added =
        decay * difference->output - more * first->output - change * lead - difference->lost;
    const imu_thermal_real sum = difference->output + added;
    difference->lost = (sum - difference->output) - added;
    difference->output = sum;
  }
}
""",
    'advance_play(': """
static void advance_play(imu_thermal_play *play, imu_thermal_real value,
                         imu_thermal_real half_width)
{
  if (!play->started) {
    play->output = value;
  }
  play->started = true;
  if (play->output < value - half_width) {
    play->output = value - half_width;
  }
  if (play->output > value + half_width) {
    play->output = value + half_width;
  }
}
""",
}
"""Functions that are written where they are called, by what their call begins with."""
STATE_TYPES = {
    'lag': """
typedef struct {
  imu_thermal_real input;  /* value at the newest sample */
  imu_thermal_real output; /* lagged value above it */
  imu_thermal_real lost;   /* what the sum lost to rounding */
  bool started;
} imu_thermal_lag;
""",
    'lag_difference': """
typedef struct {
  imu_thermal_real output; /* second lag above the first */
  imu_thermal_real lost;   /* what the sum lost to rounding */
} imu_thermal_lag_difference;
""",
    'play': """
typedef struct {
  imu_thermal_real output;
  bool started;
} imu_thermal_play;
""",
}
"""Types of the state of a signal, by its kind."""
C99_FILES = ('imu_thermal.h', 'imu_thermal.c', 'CMakeLists.txt', 'package.xml')
LIBM_FUNCTIONS = {'EXP(': 'exp', 'EXPM1(': 'expm1'}
"""Functions of libm, by what their call begins with."""
ADVANCE_STATEMENTS = """    const uint64_t since = (uint64_t)t - (uint64_t)state->newest;
    advance(state, (imu_thermal_real)since * REAL(1e-9), temperature, sample);
"""
"""Statements that take a sample into the history."""


@dataclass(frozen=True)
class C99:
    """A model as C99."""

    files: Mapping[str, str]
    """Text by file name."""
    channels: Mapping[str, int]
    """Channels that a sample holds after its nine measurements, and their components."""


def c99_of(model: ThermalModel) -> C99:
    """Return the model as C99.

    Raises ModelError where nothing is compensated in the field, or a device effect has no C form.
    """
    _refuse_what_cannot_be_written(model)
    signals = Signals()
    acting = [s for s in SENSORS if s in model.sensors and model.sensors[s].device_terms()]
    bodies = {sensor: _sensor_function(model, sensor, signals) for sensor in acting}
    code = ''.join([_advance_function(signals), *bodies.values()])
    functions = ''.join([*(text for call, text in C_FUNCTIONS.items() if call in code), code])
    count = Counter(signal.kind for signal in signals.listed)
    label = _comment(model_label(model))
    header = _template('imu_thermal.h.in').substitute(
        device=_comment(model.device or 'a device without name'),
        label=label,
        libm=' and '.join(
            ['isfinite', *(n for call, n in LIBM_FUNCTIONS.items() if call in functions)]
        ),
        channels=''.join(_channel_field(*item) for item in signals.channels.items()),
        state_types=''.join(STATE_TYPES[kind] for kind in count),
        state_fields=''.join(f'  imu_thermal_{k} {k}[{n}];\n' for k, n in count.items()),
    )
    source = _template('imu_thermal.c.in').substitute(
        label=label,
        reference_temperature=repr(float(model.reference_temperature)),
        functions=functions,
        advance=ADVANCE_STATEMENTS if signals.listed else '',
        errors=''.join(_error_call(sensor) for sensor in bodies),
    )
    shipped = resources.files(__package__)
    further = [
        shipped.joinpath(f'imu_thermal.{name}').read_text('utf-8')
        for name in ('cmake', 'package.xml')
    ]
    files = dict(zip(C99_FILES, (header, source, *further), strict=True))
    return C99(files, signals.channels)


def _refuse_what_cannot_be_written(model: ThermalModel) -> None:
    """Refuse a model without field effects or range, and all effects without C form at once."""
    if not any(part.device_terms() for part in model.sensors.values()):
        raise ModelError('sensors: no effect is compensated in the field: nothing to export')
    for sensor, part in model.sensors.items():
        if not np.isfinite(part.temperature_range).all():
            raise ModelError(f'sensors.{sensor}.temperature_range: expected two numbers')
    without = {
        f'{sensor}: {effect.name}'
        for sensor in SENSORS
        if sensor in model.sensors
        for _, effect, _ in model.sensors[sensor].device_terms()
        if effect.per_run or effect.c_columns(_form(effect, sensor, Signals())) is None
    }
    if without:
        raise ModelError(
            f'no C form: {", ".join(sorted(without))}; give the effect a method c_columns '
            '(CONTRIBUTING.md), or export a model without it'
        )


def _form(effect: Effect, sensor: Sensor, signals: Signals) -> CForm:
    """Return the names and operators for one effect."""
    return CForm(sensor, signals, effect.name, effect.needs, held=effect.bends)


def _sensor_function(model: ThermalModel, sensor: Sensor, signals: Signals) -> str:
    part = model.sensors[sensor]
    blocks = [
        _block(part, sensor, effect, coefficients, model.reference_temperature, signals)
        for _, effect, coefficients in part.device_terms()
    ]
    body = ''.join(blocks)
    low, high = (f'REAL({limit!r})' for limit in map(float, part.temperature_range))
    held = (
        f'  const imu_thermal_real held = clip(temperature, {low}, {high});\n'
        if re.search(r'\bheld\b', body)
        else ''
    )
    return (
        f'\nstatic unsigned {sensor}_error(const imu_thermal_state *state, '
        'imu_thermal_real elapsed,\n'
        f'{" " * (len(sensor) + 23)}imu_thermal_real temperature,\n'
        f'{" " * (len(sensor) + 23)}const imu_thermal_sample *sample, '
        'imu_thermal_real error[3])\n'
        f'{{\n{held}'
        f'  const bool outside = temperature < {low} || temperature > {high};\n'
        '  unsigned said = outside ? IMU_THERMAL_OUTSIDE : 0u;\n\n'
        f'{_unused(("state", "elapsed", "sample"), body)}{body}  return said;\n}}\n'
    )


def _unused(names: Sequence[str], code: str) -> str:
    """Return the statements that say which parameters a function has no use for."""
    return ''.join(f'  (void){n};\n' for n in names if not re.search(rf'\b{n}\b', code))


def _block(
    part: SensorModel,
    sensor: Sensor,
    effect: Effect,
    coefficients: FloatArray,
    reference_temperature: float,
    signals: Signals,
) -> str:
    """Return the statements that add one effect's error."""
    form = _form(effect, sensor, signals)
    made = effect.c_columns(form)
    assert made is not None  # noqa: S101 (refused before)
    for channel in effect.needs:  # one that the effect only waits for
        signals.channels.setdefault(channel, 1)
    mixed = coefficients if made.mixing is None else made.mixing @ coefficients
    lines = [*form.locals, *_sums(made, mixed)]
    if effect.bends:
        lines += _straight_on(part, sensor, effect, coefficients, reference_temperature)
    text = '{\n' + ''.join(f'    {line}\n' for line in lines) + '  }'
    if known := _known(effect.needs, signals):
        text = f'if ({known}) {text} else {{\n    said |= IMU_THERMAL_NO_CHANNEL;\n  }}'
    return f'  /* {effect.name}: {_comment(effect.equation)} */\n  {text}\n'


def _sums(made: CColumns, coefficients: FloatArray) -> list[str]:
    """Return the statements error[i] += coefficient * column."""
    lines: list[str] = []
    for expression, row in zip(made.expressions, np.asarray(coefficients), strict=True):
        values = row if np.ndim(row) else np.full(3, row)
        if isinstance(expression, str):
            name = f'c{len(lines)}'
            lines.append(f'const imu_thermal_real {name} = {expression};')
            expression = (name,) * 3  # noqa: PLW2901 (the same for every axis)
        lines += [
            f'error[{axis}] += REAL({float(value)!r}) * ({column});'
            for axis, (column, value) in enumerate(zip(expression, values, strict=True))
            if column
        ]
    return lines


def _straight_on(
    part: SensorModel,
    sensor: Sensor,
    effect: Effect,
    coefficients: FloatArray,
    reference_temperature: float,
) -> list[str]:
    """Return the statements by which an effect that bends goes on straight outside the range.

    The slopes are those of `effect.columns_from`, per kelvin beyond the edge.
    """
    lines = []
    for sign, limit in zip((-1.0, 1.0), part.temperature_range, strict=True):
        at_edge, inside = (
            effect.columns(settled_conditions(limit - shift, reference_temperature).of(sensor))[0][
                0
            ]
            for shift in (0.0, sign * EDGE_STEP_K)
        )
        slope = sign * ((at_edge - inside) / EDGE_STEP_K @ coefficients)
        lines.append(f'if (temperature {"<" if sign < 0.0 else ">"} REAL({float(limit)!r})) {{')
        lines += [
            f'  error[{axis}] += REAL({float(value)!r}) * (temperature - held);'
            for axis, value in enumerate(slope)
        ]
        lines.append('}')
    return lines


def _known(channels: Sequence[str], signals: Signals) -> str:
    """Return the condition that channels are known; '' where there are none."""
    names = [
        f'sample->{name}{suffix}'
        for name in channels
        for suffix in ([''] if signals.channels.get(name, 1) == 1 else ['[0]', '[1]', '[2]'])
    ]
    return ' && '.join(f'isfinite({name})' for name in names)


def _advance_function(signals: Signals) -> str:
    if not signals.listed:
        return ''
    lines = []
    for signal in sorted(signals.listed, key=lambda signal: get_args(Kind).index(signal.kind)):
        passed = [f'&{signals.place(signal)}', *_advanced_by(signal, signals)]
        call = f'advance_{signal.kind}({", ".join(passed)});'
        known = _known(signal.channels, signals)
        lines.append(f'  if ({known}) {{\n    {call}\n  }}\n' if known else f'  {call}\n')
    text = ''.join(lines)
    unused = _unused(('sample', 'step', 'temperature'), text)
    return (
        '\n/* Takes one more sample into the history, step [s] after the one before. */\n'
        'static void advance(imu_thermal_state *state, imu_thermal_real step, '
        'imu_thermal_real temperature,\n                    const imu_thermal_sample *sample)\n'
        f'{{\n{unused}{text}}}\n'
    )


def _advanced_by(signal: Signal, signals: Signals) -> list[str]:
    """Return what a signal's function takes beside its state."""
    numbers = [f'REAL({parameter!r})' for parameter in signal.parameters]
    if signal.kind == 'play':
        return [signal.value, *numbers]
    if signal.kind == 'lag':
        return [signal.value, 'step', *numbers]
    first, second = signal.parameters
    lag = signals.place(replace(signal, kind='lag', parameters=(first,)))
    apart = f'REAL({1.0 / first - 1.0 / second!r})'
    return [f'&{lag}', signal.value, 'step', *numbers, apart]


def _error_call(sensor: Sensor) -> str:
    return (
        f'  said |= {sensor}_error(state, elapsed, temperature, sample,\n'
        f'{" " * (len(sensor) + 17)}state->error.{SENSOR_FIELDS[sensor]});\n'
    )


def _channel_field(name: str, components: int) -> str:
    size = '' if components == 1 else f'[{components}]'
    return f'  imu_thermal_real {name}{size};\n'


def _comment(text: str) -> str:
    """Return a text as it may stand in a comment."""
    return ' '.join(text.replace('*/', '* /').split())


def _template(name: str) -> Template:
    return Template(resources.files(__package__).joinpath(name).read_text('utf-8'))
