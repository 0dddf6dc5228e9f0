# SPDX-License-Identifier: Apache-2.0
"""Fit the linear thermal model of one device and save it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError
from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.comparison.simpler import worse_than_simpler
from thermal_comp.data.device_identity import unnamed_warning
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.pooling import examine_pooling
from thermal_comp.model.values import ThermalModel
from thermal_comp.presentation.comparison import comparison_text

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_output_argument,
    read_recordings,
    save_unless_worse,
)
from imu_workbench.fleet import require_fleet
from imu_workbench.outputs import claim_output

HELP = 'Fit a line per axis against die temperature to the runs of one device; save the model.'
EPILOG = """\
examples:
  python -m imu_workbench fit bags/dut1_? -o dut1.yaml --json dut1.json
  python -m imu_workbench fit short_bag -o A00201.yaml --fleet fleet_out --lot A

With --fleet the slopes of a short campaign (`plan --fleet`) have those of the lot's other devices
as prior; without --lot those of all lots of the type, for the first devices of a new lot."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    parser.add_argument(
        '--pooled',
        action='store_true',
        help='one model for several devices, tested against a model for each',
    )
    parser.add_argument(
        '--fleet',
        metavar='DIR',
        type=Path,
        help='results of `fleet`: its devices are the prior of the slopes',
    )
    parser.add_argument('--lot', metavar='NAME', help='lot of the device in the fleet')
    parser.add_argument('--type', metavar='NAME', help='type of the device in the fleet')
    add_output_argument(parser, 'MODEL', 'model file to write')


def run(options: argparse.Namespace) -> Answer:
    """Fit, compare, save."""
    if not options.fleet and (options.lot or options.type):
        raise UserError('--lot and --type name devices of a fleet: give its results with --fleet')
    if options.fleet and options.pooled:
        raise UserError('--pooled fits several devices, --fleet shrinks one to its lot: choose')
    claim_output(options.output, force=options.force)
    recordings = read_recordings(options, at_rest=True)
    show_progress('fitting …')
    runs = prepare(recordings)
    unnamed = unnamed_warning(runs)
    warnings = [unnamed] if unnamed else []
    model = fit_prepared([BiasTemperature()], runs, pooled=options.pooled)
    if options.fleet:
        model, outside = _with_fleet(model, runs, options)
        warnings += outside
    comparison = compare_prepared(model, runs)
    worse = worse_than_simpler(model, comparison, runs)
    saved, code = save_unless_worse(model, worse, options)
    content: dict[str, Any] = comparison.to_dict() | {
        'model': None if code else str(options.output),
        'worse': list(worse),
        'warnings': warnings,
        'unplaced': {r.source: dict(r.unplaced) for r in recordings if r.unplaced},
    }
    text = [*(f'warning: {warning}' for warning in warnings), ''] if warnings else []
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


def _with_fleet(
    model: ThermalModel, runs: Sequence[PreparedRun], options: argparse.Namespace
) -> tuple[ThermalModel, list[str]]:
    """Return the model with the fleet as prior, and where the device is outside of it."""
    require_fleet()
    from imu_workbench.fleet.sources import NO_TYPE
    from imu_workbench.fleet.statistics.prior import fleet_prior, with_prior

    prior = fleet_prior(options.fleet, options.lot, options.type or NO_TYPE, model.device)
    return with_prior(model, runs, prior)
