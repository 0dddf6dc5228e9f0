# SPDX-License-Identifier: Apache-2.0
"""Open the workbench: a local web page to compare, learn, add and watch."""

from __future__ import annotations

import argparse
import secrets
import sys
from importlib.util import find_spec
from pathlib import Path

from imu_recording.user_error import UserError
from thermal_comp.effects.user_effects import effect_catalogue

from imu_workbench.answer import Answer
from imu_workbench.commands.options import (
    add_effects_argument,
    add_model_argument,
    add_topic_arguments,
    topic_remap,
)

HELP = 'Serve the workbench, a local web page: see where a model fails, add what is missing.'
EPILOG = 'example:\n  python -m imu_workbench serve bags/hidden_effect_? --port 8080'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'bags', nargs='*', metavar='BAG', type=Path, help='bags every tab opens with'
    )
    add_model_argument(parser, 'model file to begin with; else a line per axis')
    add_effects_argument(parser)
    add_topic_arguments(parser)
    parser.add_argument(
        '--root',
        metavar='DIR',
        type=Path,
        help='the page opens bags below this folder only (default: the folder of the bags)',
    )
    parser.add_argument('--port', type=int, default=8080, help='default 8080; 0: any')
    parser.add_argument(
        '--host',
        default='127.0.0.1',
        help='address to listen on (default: this machine alone; any other asks for a token)',
    )
    parser.add_argument('--token', help='the token to ask for (default: a random one)')


def run(options: argparse.Namespace) -> Answer:
    """Serve until interrupted."""
    if find_spec('nicegui') is None:
        raise UserError(
            'the workbench needs nicegui and tsdownsample: '
            'python -m pip install -r requirements-web.txt'
        )
    from imu_workbench.web.access import is_local
    from imu_workbench.web.bag_root import BagRoot
    from imu_workbench.web.page import Start
    from imu_workbench.web.server import bind, run_server

    effect_catalogue(options.effects)  # refused now rather than in every tab
    remap = topic_remap(options)
    root = BagRoot.of(options.bags, options.root)
    bags = tuple(bag.absolute() for bag in options.bags)
    model = read_model(options.model) if options.model else None
    token = options.token or ('' if is_local(options.host) else secrets.token_urlsafe(16))
    listening = bind(options.host, options.port)
    port = listening.getsockname()[1]
    name = f'[{options.host}]' if ':' in options.host else options.host
    address = f'http://{name}:{port}/' + (f'?token={token}' if token else '')

    def ready() -> None:
        sys.stdout.write(f'workbench at {address} (bags below {root.folder}); Ctrl-C ends it\n')
        sys.stdout.flush()

    start = Start(bags, model, tuple(options.effects), remap)
    run_server(listening, root, start, token=token, ready=ready)
    return Answer({'address': address, 'root': str(root.folder)}, '')


def read_model(path: Path) -> str:
    """Return the text of a model file."""
    try:
        return path.read_text('utf-8')
    except UnicodeDecodeError:
        raise UserError(f'--model {path}: not a text file; a model file is YAML') from None
