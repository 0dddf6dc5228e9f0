# SPDX-License-Identifier: Apache-2.0
"""Run a whole campaign through the real nodes in this process, faster than real time."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml
from chamber_profile.profile.file import load_profile, profile_text
from chamber_profile.profile.unroll import signed_axis
from chamber_profile.profile.values import Profile
from imu_recording.user_error import UserError
from thermal_comp.presentation.display import duration

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import add_output_argument

HELP = 'Run a profile with simulated chamber and devices through the real nodes; record it.'
EPILOG = """\
Chamber node, one driver node per device and the recorder node run in lock-step on one simulated
clock in this process. DIR then holds one bag per orientation (x, y, z, or those of the profile),
journal and profile inside each; report and diagnose take them as they are."""
DEVICES = ('dut1', 'dut2', 'dut3')
ORIENTATIONS = ('+x', '+y', '+z')


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('profile', metavar='PROFILE', help='a profile file or name (see plan)')
    add_output_argument(parser, 'DIR', 'folder of the bags')
    parser.add_argument(
        '--devices', metavar='N', type=int, default=3, help='how many devices (1 … 3)'
    )
    parser.add_argument(
        '--imu-rate', metavar='HZ', type=float, default=0.5, help='samples per second (0.5)'
    )
    parser.add_argument(
        '--time-scale', metavar='X', default='max', help="seconds per second, or 'max'"
    )
    parser.add_argument(
        '--seed', metavar='N', type=int, default=0, help='seed of all noise (default 0)'
    )


def run(options: argparse.Namespace) -> Answer:
    """Run all orientations and answer with what was recorded."""
    profile = load_profile(options.profile)
    _check(options)
    from imu_workbench.simulate.node_campaign import RunPlan, run_in_lock_step

    runs: list[dict[str, Any]] = []
    orientations = profile.orientations or ORIENTATIONS
    with tempfile.TemporaryDirectory() as scratch:
        for number, orientation in enumerate(orientations):
            path = Path(scratch) / f'{profile.name}.yaml'
            path.write_text(oriented_text(profile, orientation), encoding='utf-8')
            began = time.monotonic()
            plan = RunPlan(
                profile=path,
                orientation=orientation,
                directory=options.output / orientation.lstrip('+'),
                devices=DEVICES[: options.devices],
                imu_rate_hz=options.imu_rate,
                seed=options.seed,
                number=number,
                time_scale=_time_scale(options.time_scale),
            )
            messages = run_in_lock_step(plan, show_progress)
            took = time.monotonic() - began
            runs.append({
                'bag': str(plan.directory), 'orientation': orientation, 'messages': messages,
                'took_s': round(took, 2),
            })  # fmt: skip
    lines = [
        f'{run["bag"]}: {run["orientation"]} up, {run["messages"]} messages in '
        f'{duration(run["took_s"])}'
        for run in runs
    ]
    content = {'schema': 1, 'profile': profile.name, 'sha256': profile.sha256, 'runs': runs}
    return Answer(content, '\n'.join(lines))


def oriented_text(profile: Profile, orientation: str) -> str:
    """Return the text of the profile for one run with an axis up."""
    content = dict(yaml.safe_load(profile.text))
    if signed_axis(content.get('orientations', [''])[0] or '+x') == orientation and (
        len(content.get('orientations', [])) == 1
    ):
        return profile.text
    content['orientations'] = [orientation.lstrip('+')]
    return profile_text(content)


def _check(options: argparse.Namespace) -> None:
    if not 1 <= options.devices <= len(DEVICES):
        raise UserError(f'--devices {options.devices}: there are 1 … {len(DEVICES)}')
    rate = options.imu_rate
    whole = rate > 0.0 and min(abs(rate - round(rate)), abs(1.0 / rate - round(1.0 / rate))) < 1e-9
    if not whole or rate > 952.0:
        raise UserError(
            f'--imu-rate {rate:g}: expected whole samples per second, or seconds per sample'
        )
    _time_scale(options.time_scale)
    if options.output.exists() and any(options.output.iterdir()):
        raise UserError(f'{options.output} is not empty: a campaign needs a folder of its own')


def _time_scale(text: str) -> float:
    if text == 'max':
        return 0.0
    try:
        scale = float(text)
    except ValueError:
        scale = 0.0
    if scale <= 0.0:
        raise UserError(f"--time-scale {text}: expected a positive number or 'max'")
    return scale
