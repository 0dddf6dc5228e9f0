# SPDX-License-Identifier: Apache-2.0
"""Write the report: one HTML page that needs no network."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from thermal_comp.effects.effect import Effect
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import load_model
from thermal_comp.model.values import ModelError, ThermalModel

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_output_argument,
    claim_output,
    read_recordings,
)
from imu_workbench.report.content import command_line, versions
from imu_workbench.report.laboratory import read_laboratory
from imu_workbench.report.limits import read_limits

FORMATS = ('html', 'pdf')
HELP = 'Write calibration certificate and report of devices: one HTML page, or PDF.'
EPILOG = (
    'example:\n  python -m imu_workbench report bags/dut1_? -o report.html '
    '--laboratory examples/laboratory.yaml'
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    parser.add_argument(
        '--model',
        metavar='MODEL',
        type=Path,
        action='append',
        default=[],
        help='model of a device; repeatable. A device without one is fitted a line per axis',
    )
    parser.add_argument(
        '--no-attitude', action='store_true', help='leave the orientation filters out (faster)'
    )
    parser.add_argument(
        '--no-diagnosis', action='store_true', help='leave the search for missing effects out'
    )
    parser.add_argument(
        '--laboratory',
        metavar='YAML',
        type=Path,
        help='what the certificate states of laboratory and instruments: examples/laboratory.yaml',
    )
    parser.add_argument(
        '--limits',
        metavar='YAML',
        type=Path,
        help='limits of the coefficients, decided with their uncertainty (examples/limits.yaml)',
    )
    parser.add_argument(
        '--format',
        choices=FORMATS,
        default='html',
        help='html (default): one page with live figures; pdf: certificate and annexes on paper',
    )
    add_output_argument(parser, 'FILE', 'file to write')
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Analyse the recordings, write the page."""
    from imu_workbench.parallel import keep_memory
    from imu_workbench.report.analysis import UNNAMED, analyse_recordings, named
    from imu_workbench.report.attitude import is_slow
    from imu_workbench.report.content import report_content
    from imu_workbench.report.html.document import report_page, report_text
    from imu_workbench.report.pdf import check_pdf, report_pdf

    claim_output(options.output, force=options.force)
    if options.format == 'pdf':
        check_pdf()
    catalogue = effect_catalogue(options.effects)
    models = load_models(options.model, catalogue)
    laboratory = read_laboratory(options.laboratory) if options.laboratory else None
    limits = read_limits(options.limits) if options.limits else None
    keep_memory()
    recordings = read_recordings(options, every_device=True)
    devices = sorted({recording.device for recording in named(recordings)})
    if devices == [UNNAMED] and len(models) == 1:
        models = {UNNAMED: next(iter(models.values()))}
    check_models(models, devices)
    analysis = analyse_recordings(
        recordings,
        models,
        attitudes=not options.no_attitude and not all(map(is_slow, recordings)),
        diagnosis=not options.no_diagnosis,
        catalogue=catalogue,
        workers=os.cpu_count() or 1,
    )
    show_progress('writing the page …')
    content = report_content(
        analysis,
        commands=[command_line()],
        versions=versions(),
        laboratory=laboratory,
        limits=limits,
    )
    if options.format == 'pdf':
        options.output.write_bytes(report_pdf(content))
    else:
        options.output.write_text(report_page(content), 'utf-8')
    return Answer(content, f'{report_text(content)}\n\nwrote {options.output}')


def load_models(
    paths: Sequence[Path], catalogue: Mapping[str, type[Effect]]
) -> dict[str, ThermalModel]:
    """Return the models by device; two of one device are refused."""
    models: dict[str, ThermalModel] = {}
    for path in paths:
        model = load_model(path, catalogue)
        if model.device in models:
            raise ModelError(f'{path}: a second model of {model.device}; give one per device')
        models[model.device] = model
    return models


def check_models(models: Mapping[str, ThermalModel], devices: Sequence[str]) -> None:
    """Refuse a model of a device that was not recorded."""
    for device in models:
        if device not in devices:
            raise ModelError(
                f'the model is of {device!r}, the recordings are of {", ".join(devices)}'
            )
