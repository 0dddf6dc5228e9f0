# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as text, table and picture: verdict, findings, sensors, what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from thermal_comp.data.acting_channels import what_to_log
from thermal_comp.data.improvement import rises
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import COUNT_UNIT
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, scaled, shown
from thermal_comp.presentation.html_table import html_table

if TYPE_CHECKING:
    from thermal_comp.presentation.picture import Picture

POSITIVE_UNITS = ('s', 'K')
"""Of times and widths, which are above zero."""
VERDICTS = {
    'complete': 'nothing is missing',
    'changed': 'the device is no longer what its model says',
    'missing': 'an effect is missing',
    'ambiguous': 'an effect is missing; these runs cannot tell which of the named',
    'unexplained': 'something is missing that no effect of the catalogue explains',
    'unlogged': 'something acts that was not logged',
    'noise_above_reference': 'nothing is missing, but the noise is higher than the reference',
    'data_quality': 'the data have defects; rows that are wrong were left out of what follows',
}
"""Verdicts in words."""
LACKING = {
    'missing': 'effect',
    'ambiguous': 'effect',
    'unexplained': 'unexplained',
    'unlogged': 'unlogged',
}
"""Verdicts that something is missing, with the kind of the findings that lead to each."""
NOTHING_MISSING = frozenset({'complete', 'noise_above_reference'})
"""Verdicts on a sensor that lacks no effect."""
DEFECT_REMEDIES = {
    'saturation': 'choose a wider full scale or remove the magnet',
    'stuck_value': 'check bus and driver',
    'spikes': 'check bus and cable',
    'startup_transient': 'nothing: the first rows are cut',
    'orientation_flip': 'nothing: each part at rest is a run of its own',
    'moved': 'nothing: each part at rest is a run of its own',
    'unit_mismatch': 'convert to SI units before',
    'impossible_statistic': 'check what was logged',
    'thermometer_missing': 'find out why the driver sends no temperature there',
    'thermometer_constant': 'check that the driver reads the thermometer',
    'thermometer_whole_degrees': 'let the driver send the fractions of a degree',
    'thermometer_copied': 'log the temperature of the die itself',
    'thermometer_scale': 'check the counts per kelvin, or the unit, of the thermometer',
    'coarse_clock': 'stamp samples with a clock of microseconds',
}
"""What to do about each defect of the data."""


def diagnosis_text(content: Mapping[str, Any]) -> str:
    """Return the diagnosis (the dictionary that --json writes) as lines."""
    name = content.get('device') or 'device'
    lines = [f'{name}: {verdict_line(content)}']
    for finding in content['findings']:
        lines += _finding_lines(finding)
    lines += explanation_lines(content['explanations'])
    lines += prediction_lines(content)
    for sensor, state in content['sensors'].items():
        unit = DISPLAY_UNITS[sensor]
        error, floor = (
            ' '.join(shown(scaled(value, unit.factor)) for value in state[key])
            for key in ('held_out_rms', 'noise_floor')
        )
        lines.append(
            f'  {sensor:<14} {state["verdict"]:<12} held out {error} {unit.unit}, '
            f'noise floor {floor}'
        )
        if state.get('smallest_found'):
            lines.append(f'    would have been found: {_range_found(sensor, state)}')
        if state['where'] and state['verdict'] not in NOTHING_MISSING:
            lines.append(
                f'    worst: {"; ".join(_where_text(where) for where in state["where"][:3])}'
            )
    lines += undecided_lines(content.get('undecided', ()))
    lines += [f'  undetermined: {text}' for text in content['undetermined']]
    lines += _greyed_lines(content['greyed_out'])
    lines += [f'  note: {text}' for text in dict.fromkeys(content['notes'])]
    lines += [f'  next: {text}' for text in advice(content)]
    return '\n'.join(lines)


def verdict_line(content: Mapping[str, Any]) -> str:
    """Return the verdict in words, and what it is about."""
    doubt = doubtful_sensors(content)
    if content['verdict'] == 'complete' and doubt:
        named = ', '.join(f'{sensor}, {percent(p)}' for sensor, p in doubt.items())
        return f'nothing is missing for certain, but something may be ({named})'
    erring = erring_thermometer(content)
    if erring and content['verdict'] in NOTHING_MISSING:
        return f'no effect is missing, but the thermometer errs ({erring})'
    judged = list(content['sensors'])
    if content['verdict'] == 'complete' and 0 < len(judged) < len(SENSORS):
        return f'{VERDICTS["complete"]} in {" and ".join(judged)}, all that could be judged'
    said = VERDICTS[content['verdict']] + _summary(content, content['verdict'])
    if content['verdict'] not in {*LACKING, 'data_quality'}:
        return said
    kinds = {finding['kind'] for finding in content['findings']}
    kinds -= {LACKING.get(content['verdict'])}
    further = [one for one in ('missing', 'unexplained', 'unlogged') if LACKING[one] in kinds]
    return '; '.join([said, *(VERDICTS[one] + _summary(content, one) for one in further)])


def doubtful_sensors(content: Mapping[str, Any]) -> dict[str, float]:
    """Return sensors called complete that probably lack something: name → probability of that."""
    nothing = {s: 0.0 for s, state in content['sensors'].items() if state['verdict'] == 'complete'}
    explained = {e['sensor'] for e in content['explanations']}
    for one in content['explanations']:
        if one['names'] == ['nothing'] and one['sensor'] in nothing:
            nothing[one['sensor']] = one['probability']
    return {s: 1.0 - p for s, p in nothing.items() if s in explained and p < 0.5}


def corrections_of_thermometer(content: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return sensor → prediction where only what the thermometer does is to be corrected."""
    return {
        sensor: one
        for sensor, one in content.get('prediction', {}).items()
        if one['empirical'] and one['terms'] and _lacks_nothing(content, sensor)
    }


def erring_thermometer(content: Mapping[str, Any]) -> str:
    """Return these sensors with their held-out errors in noise floors; '' where there are none."""
    return ', '.join(
        f'{sensor} {one["error_before"] / one["noise_floor"]:.1f} × noise'
        for sensor, one in corrections_of_thermometer(content).items()
    )


def _lacks_nothing(content: Mapping[str, Any], sensor: str) -> bool:
    return content['sensors'].get(sensor, {}).get('verdict') in NOTHING_MISSING


def _summary(content: Mapping[str, Any], verdict: str) -> str:
    """Return what a verdict is about, in a few words."""
    wanted = LACKING.get(verdict, verdict)
    parts = []
    for finding in content['findings']:
        if finding['kind'] != wanted:
            continue
        names = [finding['name'], *finding['ambiguous_with']]
        what = ' or '.join(n for n in names if n) or f'depends on {finding["depends_on"]}'
        parts.append(f'{what} ({finding["sensor"]})')
    return f': {", ".join(parts)}' if parts else ''


def prediction_lines(content: Mapping[str, Any]) -> list[str]:
    """Return what adding effects would bring where no cause is decided."""
    lines = []
    for sensor, one in content['prediction'].items():
        if not one['empirical']:
            continue
        unit = DISPLAY_UNITS[sensor]
        before, after, floor = (
            shown(one[key] * unit.factor) for key in ('error_before', 'error_after', 'noise_floor')
        )
        terms = ', '.join(one['terms'])
        text = f'add {terms} would bring held-out error {before} → {after}'
        if not one['terms']:
            text = f'no effect of the catalogue would lower the held-out error {before}'
        elif one['error_after'] >= one['error_before']:
            text = f'{terms}, what comes closest, would not lower the held-out error {before}'
        lacks_nothing = _lacks_nothing(content, sensor)
        cause = 'the thermometer errs' if lacks_nothing else 'cause undecided'
        lines.append(f'  {sensor}: {text} {unit.unit}, noise floor {floor}; {cause}')
    return lines


def _range_found(sensor: str, state: Mapping[str, Any]) -> str:
    """Return the effects that are found most and least easily, with the rms each needs."""
    unit = DISPLAY_UNITS[sensor]
    by_size = sorted(state['smallest_found'].items(), key=lambda item: item[1])
    ends = ' … '.join(
        f'{name} from {shown(rms * unit.factor, 2)}'
        for name, rms in by_size[:: max(len(by_size) - 1, 1)]
    )
    return f'{ends} {unit.unit} rms'


def explanation_lines(explanations: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what may explain each sensor's residual, where that is in doubt."""
    by_sensor: dict[str, list[Mapping[str, Any]]] = {}
    for one in explanations:
        by_sensor.setdefault(one['sensor'], []).append(one)
    lines = []
    for sensor, several in by_sensor.items():
        if several[0]['names'] == ['nothing'] or len(several) == 1:
            continue
        shares = ', '.join(f'{explanation_name(e)} {percent(e["probability"])}' for e in several)
        lines.append(f'  {sensor}: {shares}')
    return lines


def percent(probability: float) -> str:
    """Return a probability in percent; nothing is certain.

    >>> percent(0.862), percent(0.99993)
    ('86 %', '> 99 %')
    """
    return '> 99 %' if probability > 0.99 else f'{100.0 * probability:.0f} %'


def explanation_name(explanation: Mapping[str, Any]) -> str:
    """Return one explanation in words."""
    text = ' + '.join(explanation['names']).replace('not_in_catalogue', 'not in the catalogue')
    if explanation['depends_on']:
        text += f' ({explanation["depends_on"]})'
    return text


def undecided_lines(undecided: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the pairs of effects that cannot be decided between, grouped by reason."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for pair in undecided:
        groups.setdefault((pair['reason'], pair['action']), []).append(pair)
    lines = []
    for (reason, action), pairs in groups.items():
        sensors = ', '.join(dict.fromkeys(s for pair in pairs for s in pair['sensors']))
        names = ', '.join(
            ' or '.join(pair['between'])
            + (f' ({pair["similarity"]:.0%} alike)' if pair['similarity'] < 1.0 else '')
            for pair in pairs
        )
        lines += [f'  cannot be decided ({sensors}): {names}', f'    {reason}; {action}']
    return lines


def _greyed_lines(greyed: Mapping[str, str]) -> list[str]:
    """Return the effects that were not tried, grouped by reason."""
    reasons: dict[str, list[str]] = {}
    for effect, reason in greyed.items():
        reasons.setdefault(reason, []).append(effect)
    told = '; '.join(f'{", ".join(effects)} ({reason})' for reason, effects in reasons.items())
    return [f'  not tried: {told}'] if told else []


def _finding_lines(finding: Mapping[str, Any]) -> list[str]:
    known, weights = finding['probability'], []
    if known is not None:
        weights.append(f'probability {percent(known)}')
    if known is None or finding['evidence'] > 0.0:  # what has no name has no equation to weigh
        weights.append(f'evidence {finding["evidence"]:.0f}')
        weights += [f'needed {finding["threshold"]:.0f}'] * (finding['threshold'] > 0.0)
    lines = [f'  {finding["text"]} ({", ".join(weights)})']
    sensor = finding['sensor'].split('+')[0]
    if finding['error_after'] is not None and sensor in DISPLAY_UNITS:
        unit = DISPLAY_UNITS[sensor]
        before, after, floor = (
            shown(finding[key] * unit.factor)
            for key in ('error_before', 'error_after', 'noise_floor')
        )
        lines.append(f'    held-out error {before} → {after} {unit.unit}, noise floor {floor}')
    for name, value in finding['parameters'].items():
        spread = '' if value['std'] is None else f' ± {_number(value["std"])}'
        unit = value['unit'].removeprefix(COUNT_UNIT)
        width = ' (± one standard deviation)' if spread else ''
        if _is_unknown(value):
            width = ' (not told by these recordings)'
        lines.append(f'    {name} = {_number(value["value"])}{spread} {unit}'.rstrip() + width)
    if finding['rivals']:
        rivals = ', '.join(
            f'{r["name"]} {percent(r["probability"])}' for r in finding['rivals'][:3]
        )
        together = ', alone or together' * (len(finding['rivals']) > 1)
        lines.append(f'    in its place{together}: {rivals}')
    return lines


def _is_unknown(value: Mapping[str, Any]) -> bool:
    """Tell whether a time or a width may be any: its standard deviation is as large as itself."""
    values, deviations = (
        list(each) if isinstance(each, list | tuple) else [each]
        for each in (value['value'], value['std'])
    )
    if value['unit'] not in POSITIVE_UNITS or None in deviations or len(values) != len(deviations):
        return False
    return bool(values) and all(d >= v > 0.0 for v, d in zip(values, deviations, strict=True))


def _number(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f'({", ".join(_number(item) for item in value)})'
    return f'{value:.4g}'


def _where_text(where: Mapping[str, Any]) -> str:
    ratio = f'{where["ratio"]:.1f} × floor'
    if set(where) - {'ratio', 'rms'} == {'phase', 'cycle'}:
        return f'{where["phase"]} {where["cycle"]} {ratio}'
    parts = [f'{key} {value}' for key, value in where.items() if key not in {'ratio', 'rms'}]
    return f'{", ".join(parts)} {ratio}'


def advice(content: Mapping[str, Any]) -> list[str]:
    """Return what to do next, once each, in the order of the findings."""
    lines = [line for finding in content['findings'] for line in _of_finding(finding)]
    if corrections_of_thermometer(content):
        lines.append(
            'correct what the thermometer does: python -m imu_workbench auto BAG… -o model.yaml'
        )
    return list(dict.fromkeys(lines))


def _of_finding(finding: Mapping[str, Any]) -> Sequence[str]:
    kind, name, variable = finding['kind'], finding['name'], finding['depends_on']
    if kind == 'changed':
        return ['fit it anew: python -m imu_workbench fit BAG… -o model.yaml']
    if kind == 'clock':
        return []
    if kind == 'effect' and name == 'clock_temperature':
        return ['stamp the samples by the host, or scale the interval by temperature']
    if kind == 'effect':
        left_out = better_left_out(finding)
        first = left_out or f'add {name}: python -m imu_workbench add {name} BAG… -o model.yaml'
        rivals = finding['ambiguous_with']
        if not rivals:
            return [first]
        separate = f'next-experiment {name} {rivals[0]} --model MODEL -o plan.yaml'
        either = '' if left_out else 'or '
        return [first, f'{either}separate them first: python -m imu_workbench {separate}']
    if kind == 'unlogged':
        return [f'log {what_to_log(variable, EFFECTS)} and record again']
    if kind == 'unexplained':
        return [f'look at the residual over {variable}: python -m imu_workbench compare BAG…']
    if kind == 'noise':
        return ['noise cannot be compensated: compare with another unit (--noise-reference MODEL)']
    return [f'{name}: {DEFECT_REMEDIES[name]}'] if name in DEFECT_REMEDIES else []


def better_left_out(finding: Mapping[str, Any]) -> str:
    """Return the advice to leave an effect out where its correction does not help, else ''."""
    before, after = (finding[key] or 0.0 for key in ('error_before', 'error_after'))
    if finding['kind'] != 'effect' or not 0.0 < before <= after:
        return ''
    change = 'raises' if rises(before, after) else 'does not lower'
    name = finding['name']
    return f'leave {name} out of the model: its correction {change} the held-out error'


text = diagnosis_text


def table(content: Mapping[str, Any]) -> str:
    """Return the state of each sensor as an HTML table, findings and what to do next below it."""
    head = ['sensor', 'state', 'held-out error x', 'y', 'z', 'noise floor x', 'y', 'z', 'unit']
    rows = []
    for sensor in (s for s in SENSORS if s in content['sensors']):
        state, unit = content['sensors'][sensor], DISPLAY_UNITS[sensor]
        errors = [*state['held_out_rms'], *state['noise_floor']]
        numbers = [shown(scaled(error, unit.factor)) for error in errors]
        rows.append([sensor, state['verdict'], *numbers, unit.unit])
    notes = [line.strip() for finding in content['findings'] for line in _finding_lines(finding)]
    title = f'{content.get("device") or "device"}: {verdict_line(content)}'
    return html_table(title, head, rows, [*notes, *(f'next: {line}' for line in advice(content))])


def picture(diagnosis: Any) -> Picture:
    """Return the held-out error of each axis in noise floors, before and with each finding."""
    from thermal_comp.presentation.picture import new_picture

    content = diagnosis.to_dict()
    sensors = [s for s in SENSORS if s in content['sensors']]
    figure, panels = new_picture(len(sensors))
    for panel, sensor in zip(panels, sensors, strict=True):
        state = content['sensors'][sensor]
        pairs = zip(state['held_out_rms'], state['noise_floor'], strict=True)
        panel.bar(range(3), [error / floor for error, floor in pairs], 0.6)
        panel.axhline(1.0, color='k', ls='--', lw=1, label='noise floor')
        for finding in content['findings']:
            if finding['error_after'] and sensor in finding['sensor'].split('+'):
                ratio = finding['error_after'] / finding['noise_floor']
                label = f'with {finding["name"]}'
                panel.axhline(ratio, color='C1', lw=1.5, label=label)
        panel.set(title=f'{sensor}: {state["verdict"]}', ylabel='held-out error [noise floors]')
        panel.set_xticks(range(3), 'xyz')
        panel.legend(fontsize='small')
    return figure
