# SPDX-License-Identifier: Apache-2.0
"""Fit the linear thermal model of one device and save it."""

from __future__ import annotations

import argparse
from typing import Any

from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.comparison.simpler import worse_than_simpler
from thermal_comp.data.device_identity import unnamed_warning
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.pooling import examine_pooling
from thermal_comp.presentation.comparison import comparison_text

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_output_argument,
    claim_output,
    read_recordings,
    save_unless_worse,
)

HELP = 'Fit a line per axis against die temperature to the runs of one device; save the model.'
EPILOG = 'example:\n  python -m imu_workbench fit bags/dut1_? -o dut1.yaml --json dut1.json'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    parser.add_argument(
        '--pooled',
        action='store_true',
        help='one model for several devices, tested against a model for each',
    )
    add_output_argument(parser, 'MODEL', 'model file to write')


def run(options: argparse.Namespace) -> Answer:
    """Fit, compare, save."""
    claim_output(options.output, force=options.force)
    recordings = read_recordings(options, at_rest=True)
    show_progress('fitting …')
    runs = prepare(recordings)
    warning = unnamed_warning(runs)
    model = fit_prepared([BiasTemperature()], runs, pooled=options.pooled)
    comparison = compare_prepared(model, runs)
    worse = worse_than_simpler(model, comparison, runs)
    saved, code = save_unless_worse(model, worse, options)
    content: dict[str, Any] = comparison.to_dict() | {
        'model': None if code else str(options.output),
        'worse': list(worse),
        'warnings': [warning] if warning else [],
        'unplaced': {r.source: dict(r.unplaced) for r in recordings if r.unplaced},
    }
    text = [f'warning: {warning}', ''] if warning else []
    text += [comparison_text(content), *(f'note: {note}' for note in model.provenance.notes)]
    if options.pooled and len({run.device for run in runs}) > 1:
        show_progress('testing whether the devices may share a model …')
        tests = examine_pooling(recordings)[1]
        content['pooling'] = {sensor: test.to_dict() for sensor, test in tests.items()}
        text += ['', 'May the devices share one model?']
        text += [f'  {line}' for test in tests.values() for line in test.lines()]
        opposite = sum(sum(test.opposite_signs) for test in tests.values())
        verdict = 'one model cannot hold for all' if opposite else 'signs do not speak against it'
        text.append(f'  {opposite} of {3 * len(tests)} axes have opposite signs: {verdict}')
    text.append(saved)
    return Answer(content, '\n'.join(text), code)
