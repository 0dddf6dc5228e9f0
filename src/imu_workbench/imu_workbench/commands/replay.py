# SPDX-License-Identifier: Apache-2.0
"""Replay a bag through a node's callbacks; write what it publishes, or compare it."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml
from imu_recording.bags.messages import write_messages
from imu_recording.user_error import UserError

from imu_recording import bag_namespaces
from imu_workbench.answer import CHECK_FAILED, Answer, show_progress
from imu_workbench.commands.options import add_effects_argument, topic_remap
from imu_workbench.golden_run import columns_of, find_drift, read_golden, write_golden
from imu_workbench.replay import NODES, PublishedMessage, as_bag_messages, replay

HELP = 'Run a bag through a node in-process, as fast as possible and the same every time.'
EPILOG = (
    'Exit code 3: with --check, something moved; the first sample that did is named.\n'
    'examples:\n'
    '  python -m imu_workbench replay bags/dut1_motion --node ahrs_filter -o out\n'
    '  python -m imu_workbench replay my_bag --node ahrs_filter --write-golden my_bag.json\n'
    '  python -m imu_workbench replay my_bag --node ahrs_filter --check my_bag.json'
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('bag', metavar='BAG', type=Path, help='a bag with imu/data_raw')
    parser.add_argument('--node', required=True, metavar='NODE', help=f'one of {", ".join(NODES)}')
    parser.add_argument(
        '-p',
        dest='parameters',
        metavar='NAME:=VALUE',
        action='append',
        default=[],
        help='parameter of the node; repeatable',
    )
    add_effects_argument(parser)
    parser.add_argument('-o', '--output', metavar='DIR', type=Path, help='bag to write')
    parser.add_argument('--namespace', metavar='/NAME', help='the device to take')
    parser.add_argument(
        '--topic', metavar='NAME:=OTHER', action='append', default=[], help='rename an input'
    )
    parser.add_argument('--topics', metavar='YAML', type=Path, help='file of such rules')
    parser.add_argument('--check', metavar='GOLDEN', type=Path, help='compare with a golden run')
    parser.add_argument(
        '--tolerance', type=float, default=1e-9, help='largest difference (default 1e-9)'
    )
    parser.add_argument('--write-golden', metavar='GOLDEN', type=Path, help='write a golden run')


def run(options: argparse.Namespace) -> Answer:
    """Replay, then write or compare."""
    _check_options(options)
    sent = replay(
        options.bag,
        options.node,
        _parameters(options),
        namespace=_namespace(options),
        remap=topic_remap(options),
        progress=lambda done, of: show_progress(f'{options.node}: {done} of {of} messages'),
    )
    show_progress('')
    counts: dict[str, int] = {}
    for item in sent:
        counts[item.topic] = counts.get(item.topic, 0) + 1
    content: dict[str, Any] = {'schema': 1, 'bag': options.bag, 'node': options.node}
    content['published'] = counts
    lines = [f'{topic}: {count} messages' for topic, count in counts.items()]
    if options.output:
        messages, types = as_bag_messages(sent)
        write_messages(messages, types, options.output)
        lines.append(f'wrote {options.output}')
    return _golden(options, sent, content, lines)


def _golden(
    options: argparse.Namespace,
    sent: list[PublishedMessage],
    content: dict[str, Any],
    lines: list[str],
) -> Answer:
    """Write or check the golden run, as asked."""
    exit_code = 0
    if options.write_golden:
        made_by = {
            'node': options.node,
            'parameters': _parameters(options),
            'bag': options.bag.name,
        }
        write_golden(options.write_golden, columns_of(sent), made_by)
        lines.append(f'wrote {options.write_golden}')
    if options.check:
        drift = find_drift(columns_of(sent), read_golden(options.check), options.tolerance)
        content['drift'] = None if drift is None else str(drift)
        exit_code = 0 if drift is None else CHECK_FAILED
        same = f'as {options.check}, within {options.tolerance:g}'
        lines.append(same if drift is None else f'moved: {drift}')
    return Answer(content, '\n'.join(lines), exit_code)


def _check_options(options: argparse.Namespace) -> None:
    if not (options.output or options.check or options.write_golden):
        raise UserError('nothing to do: give -o DIR, --check GOLDEN or --write-golden GOLDEN')
    if options.output and options.output.exists():
        raise UserError(f'{options.output} exists already: remove it or choose another -o')
    if options.check and not options.check.is_file():
        raise UserError(f'{options.check}: no such file; make it with --write-golden')
    if not options.tolerance >= 0:
        raise UserError(f'--tolerance {options.tolerance:g}: it has to be 0 or more')


def _namespace(options: argparse.Namespace) -> str:
    """Return the device's namespace, which has to be chosen where there are several."""
    if options.namespace is not None:
        return str(options.namespace)
    if 'imu/data_raw' in topic_remap(options):
        return ''
    namespaces = bag_namespaces(options.bag)
    if len(namespaces) > 1:
        names = ', '.join(namespaces)
        raise UserError(f'{options.bag} holds several devices: {names}; choose with --namespace')
    return namespaces[0] if namespaces else ''


def _parameters(options: argparse.Namespace) -> dict[str, Any]:
    """Return the node's parameters; --effects is its parameter of that name."""
    parameters = parameters_of(options.parameters)
    if options.effects:
        parameters['effects'] = [str(path) for path in options.effects]
    return parameters


def parameters_of(rules: list[str]) -> dict[str, Any]:
    """Return -p rules as values.

    >>> parameters_of(['cutoff_hz:=5', 'preset:=robust', 'gyroscope_noise:=2e-4'])
    {'cutoff_hz': 5, 'preset': 'robust', 'gyroscope_noise': 0.0002}
    """
    parameters = {}
    for rule in rules:
        name, separator, text = rule.partition(':=')
        if not (separator and name):
            raise UserError(f'-p {rule!r}: write it as name:=value, e.g. cutoff_hz:=5')
        value = yaml.safe_load(text)
        if isinstance(value, str):
            with suppress(ValueError):  # YAML 1.1 takes 2e-4 for a word; ROS does not
                value = float(value)
        parameters[name] = value
    return parameters
