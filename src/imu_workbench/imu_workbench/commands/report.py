# SPDX-License-Identifier: Apache-2.0
"""Write the report: one HTML page that needs no network."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import load_model
from thermal_comp.model.values import ModelError, ThermalModel

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_noise_reference_argument,
    add_output_argument,
    noise_reference,
    read_recordings,
)
from imu_workbench.outputs import claim_output
from imu_workbench.report.content import command_line, versions
from imu_workbench.report.laboratory import read_laboratory
from imu_workbench.report.limits import read_limits

FORMATS = ('html', 'pdf', 'dcc')
HELP = 'Write calibration certificate and report of devices: HTML, PDF or DCC.'
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
        help='html (default): one page with live figures; pdf: certificate and annexes on '
        'paper; dcc: PTB Digital Calibration Certificate (XML)',
    )
    parser.add_argument(
        '--schema', metavar='XSD', type=Path, help='dcc.xsd to validate a DCC against'
    )
    parser.add_argument(
        '--sign',
        metavar='PEM',
        type=Path,
        nargs=2,
        help='private key and its certificate: sign a DCC (XMLDSig, enveloped)',
    )
    add_noise_reference_argument(parser)
    add_output_argument(parser, 'FILE', 'file to write')
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Analyse the recordings, write the page."""
    from imu_workbench.parallel import keep_memory
    from imu_workbench.report.analysis import UNNAMED_DEVICE, analyse_recordings, named
    from imu_workbench.report.attitude import is_slow
    from imu_workbench.report.content import report_content
    from imu_workbench.report.html.document import report_text

    claim_output(options.output, force=options.force)
    check_format(options)
    catalogue = effect_catalogue(options.effects)
    models = load_models(options.model, catalogue)
    laboratory = read_laboratory(options.laboratory) if options.laboratory else None
    limits = read_limits(options.limits) if options.limits else None
    reference = noise_reference(options, catalogue)
    keep_memory()
    recordings = read_recordings(options, every_device=True)
    devices = sorted({recording.device for recording in named(recordings)})
    if devices == [UNNAMED_DEVICE] and len(models) == 1:
        models = {UNNAMED_DEVICE: next(iter(models.values()))}
    check_models(models, devices)
    analysis = analyse_recordings(
        recordings,
        models,
        attitudes=not options.no_attitude and not all(map(is_slow, recordings)),
        diagnosis=not options.no_diagnosis,
        catalogue=catalogue,
        reference=reference,
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
    note = write_report(content, options)
    return Answer(content, f'{report_text(content)}\n\nwrote {options.output}{note}')


def check_format(options: argparse.Namespace) -> None:
    """Refuse at once what could not be written in the end."""
    from imu_workbench.report.dcc import check_dcc, load_schema
    from imu_workbench.report.pdf import check_pdf

    if options.format != 'dcc' and (options.schema or options.sign):
        raise UserError('--schema and --sign are for --format dcc')
    if options.format == 'pdf':
        check_pdf()
    elif options.format == 'dcc':
        check_dcc(signed=bool(options.sign))
        for path in (options.schema, *(options.sign or ())):
            if path and not path.is_file():
                raise UserError(f'{path}: no such file')
        if options.schema:
            load_schema(options.schema)


def write_report(content: Mapping[str, Any], options: argparse.Namespace) -> str:
    """Write the report in its format; return a remark to show beside its name."""
    from imu_workbench.report.dcc import (
        DCC_VERSION,
        certificate_xml,
        load_schema,
        signed,
        validated,
        xml_bytes,
    )
    from imu_workbench.report.html.document import report_page
    from imu_workbench.report.pdf import report_pdf

    if options.format == 'html':
        options.output.write_text(report_page(content), 'utf-8')
        return ''
    if options.format == 'pdf':
        options.output.write_bytes(report_pdf(content))
        return ''
    schema, version = load_schema(options.schema) if options.schema else (None, DCC_VERSION)
    root = certificate_xml(content, version)
    note = f'structure of schema {version}, not validated: give --schema dcc.xsd'
    if schema is not None:
        note = validated(root, schema, options.schema)
    if options.sign:
        root, note = signed(root, *options.sign), f'{note}, signed'
    options.output.write_bytes(xml_bytes(root))
    return f' ({note})'


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
