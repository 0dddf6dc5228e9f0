# SPDX-License-Identifier: Apache-2.0
"""Run the paper's campaign with simulated devices and put its tables and figures beside ours."""

from __future__ import annotations

import argparse
import os
from dataclasses import replace

from imu_recording.user_error import UserError

from imu_recording import ImuRecording
from imu_workbench.answer import Answer, show_progress, write_json
from imu_workbench.commands.options import add_effects_argument, add_output_argument
from imu_workbench.report.content import command_line, versions
from imu_workbench.tables.paper import PAPER_PROFILE

HELP = "Run the paper's whole campaign, and write our Tables III–VII and Figures 4–8 beside its."
EPILOG = (
    'Three devices, three orientations; one run at the rate the filters need, which the report\n'
    'shows in Figures 4 … 8, the others at 0.5 Hz, interpolated for the filters, which is said.\n'
    'doc/paper.md says which table and figure comes from which command.\n'
    'example:\n  python -m imu_workbench reproduce paper -o paper_run'
)
DEVICE_SEEDS = {'dut1': 1, 'dut2': 2, 'dut3': 3}
"""Device → seed of its campaign, as of the bundled bags."""
FILTERLESS_RATE_HZ = 0.5
FAST_RUN = ('dut1', 'x')


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('what', choices=('paper',), help='Betta et al. 2022')
    parser.add_argument(
        '--profile', default=PAPER_PROFILE, metavar='PROFILE', help='plan of every run'
    )
    parser.add_argument(
        '--rate', type=float, default=50.0, metavar='HZ', help='rate of the one run (default 50)'
    )
    parser.add_argument(
        '--no-attitude', action='store_true', help='leave the orientation filters out (faster)'
    )
    add_effects_argument(parser)
    add_output_argument(parser, 'DIR', 'folder to write: report.html, report.json')


def run(options: argparse.Namespace) -> Answer:
    """Simulate nine runs, analyse, write the report."""
    from thermal_comp.effects.user_effects import effect_catalogue

    from imu_workbench.parallel import keep_memory
    from imu_workbench.report.analysis import analyse_recordings
    from imu_workbench.report.content import report_content
    from imu_workbench.report.html.document import report_page, report_text

    if not 0.0 < options.rate <= 952.0:
        raise UserError(f'--rate {options.rate:g}: choose from above 0 to 952 Hz')
    page, numbers = options.output / 'report.html', options.output / 'report.json'
    if page.exists() and not options.force:
        raise UserError(f'{page} exists already: choose another -o, or replace it with --force')
    catalogue = effect_catalogue(options.effects)
    keep_memory()
    options.output.mkdir(parents=True, exist_ok=True)
    analysis = analyse_recordings(
        simulated_campaign(options.profile, options.rate),
        attitudes=not options.no_attitude,
        catalogue=catalogue,
        workers=os.cpu_count() or 1,
    )
    show_progress('writing the page …')
    content = report_content(analysis, commands=[command_line()], versions=versions())
    page.write_text(report_page(content), 'utf-8')
    write_json(content, numbers)
    return Answer(content, f'{report_text(content)}\n\nwrote {page} and {numbers}')


def simulated_campaign(profile: str, rate_hz: float) -> list[ImuRecording]:
    """Return the runs of all devices and orientations, named as the bundled bags are."""
    from imu_workbench.simulate.campaign import ORIENTATIONS, Logging, simulate_run

    recordings = []
    for device, seed in DEVICE_SEEDS.items():
        for orientation in ORIENTATIONS:
            axis = orientation[-1]
            show_progress(f'simulating {device}, {axis} up …')
            rate = rate_hz if (device, axis) == FAST_RUN else FILTERLESS_RATE_HZ
            logging = Logging(rate, chamber_period=10.0)
            made = simulate_run(profile, device, logging, seed=seed, orientation=orientation)
            recordings.append(replace(made, run=f'{device}_{axis}'))
    return recordings
