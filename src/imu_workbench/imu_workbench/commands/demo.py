# SPDX-License-Identifier: Apache-2.0
"""The demonstration: a device simulated at 50 Hz, the bundled bags for the rest, the report.

It ends with a hidden effect: where the model fails, what is missing, what adding it brings.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

from imu_recording.user_error import UserError

from imu_recording import read_bag
from imu_workbench.answer import Answer, show_progress, write_json
from imu_workbench.commands.options import add_effects_argument
from imu_workbench.report.content import command_line, versions
from imu_workbench.tables.paper import PAPER_PROFILE

HELP = 'Simulate a device, add the bundled bags, find a hidden effect; write DIR/report.html.'
SIMULATED_RUN = 'dut1_x_50hz'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        '-o', '--output', metavar='DIR', type=Path, default=Path('demo'), help='default: demo'
    )
    parser.add_argument(
        '--bags', metavar='DIR', type=Path, default=Path('bags'), help='folder of the bundled bags'
    )
    parser.add_argument(
        '--seed',
        metavar='N',
        type=int,
        default=50,
        help='seed of the simulated device (default 50)',
    )
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Simulate, analyse, write."""
    from thermal_comp.effects.user_effects import effect_catalogue

    from imu_workbench.parallel import keep_memory, start_task
    from imu_workbench.report.analysis import analyse_recordings
    from imu_workbench.report.content import report_content
    from imu_workbench.report.html.document import report_page, report_text
    from imu_workbench.report.model_growth import ModelGrowthTask
    from imu_workbench.simulate.campaign import Logging, simulate_run

    paths, hidden = (sorted(options.bags.glob(name)) for name in ('dut?_?', 'hidden_effect_?'))
    if not paths or not hidden:
        raise UserError(
            f'{options.bags}: no bags dut?_? and hidden_effect_? here; run from the root of the '
            'workspace, or say where they are with --bags'
        )
    catalogue = effect_catalogue(options.effects)
    keep_memory()
    options.output.mkdir(parents=True, exist_ok=True)
    workers = os.cpu_count() or 1
    growth_result = start_task(ModelGrowthTask(hidden, catalogue), workers)
    show_progress(f'simulating {PAPER_PROFILE} at 50 Hz …')
    simulated = simulate_run(
        PAPER_PROFILE, 'dut1', Logging(50.0), seed=options.seed, orientation='+x'
    )
    bags = [read_bag(path) for path in paths]
    analysis = analyse_recordings(
        [replace(simulated, run=SIMULATED_RUN), *bags], catalogue=catalogue, workers=workers
    )
    growth = growth_result()
    alone = (
        f'python -m imu_workbench simulate {PAPER_PROFILE} --device dut1 --orientation x '
        f'--rate 50 --seed {options.seed} -o {SIMULATED_RUN}  # the 50 Hz run by itself'
    )
    found = f'python -m imu_workbench auto {" ".join(growth["bags"])} -o better.yaml'
    show_progress('writing the page …')
    content = report_content(
        analysis,
        commands=[command_line(), alone, f'{found}  # the hidden effect by itself'],
        versions=versions(),
        growth=growth,
    )
    page, numbers = options.output / 'report.html', options.output / 'report.json'
    page.write_text(report_page(content), 'utf-8')
    write_json(content, numbers)
    told = '\n'.join(growth['lines'])
    return Answer(content, f'{report_text(content)}\n\nwrote {page} and {numbers}\n\n{told}')
