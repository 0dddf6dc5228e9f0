# SPDX-License-Identifier: Apache-2.0
"""Open the workbench: a local web page of a case, its verdict first."""

from __future__ import annotations

import argparse
import hashlib
import os
import secrets
import sys
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from threading import Thread

from imu_recording.user_error import UserError

from imu_workbench.answer import Answer
from imu_workbench.case import cases_in, is_case, load_case
from imu_workbench.commands.options import (
    add_effects_argument,
    add_model_argument,
    add_topic_arguments,
    topic_remap,
)
from imu_workbench.web.work.jobs import warm_up

HELP = 'Serve the workbench, a local web page: what a device lacks, in a sentence; then add it.'
EPILOG = """\
examples:
  python -m imu_workbench serve bags/hidden_effect_? --port 8080
  python -m imu_workbench serve bags/hidden_effect_? --case my_cases
  python -m imu_workbench serve my_cases/dut2

A case is a folder: recordings, findings and every version of a device's model, saved at every
step. Bags make one for each device, or go on with the one there is."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'paths', nargs='*', metavar='CASE|BAG', type=Path, help='a case, or bags that make one'
    )
    parser.add_argument(
        '--case',
        metavar='DIR',
        type=Path,
        help='folder of the cases that bags make (default: one for each folder of bags, in '
        '~/.local/share/imu_workbench)',
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
    bags, cases = sort_paths(options.paths)  # what does not exist is refused before all else
    if find_spec('nicegui') is None:
        raise UserError(
            'the workbench needs nicegui and tsdownsample: '
            'python -m pip install -r requirements-web.txt'
        )
    Thread(target=warm_up, daemon=True).start()  # workers get ready while all below is imported
    from thermal_comp.effects.user_effects import effect_catalogue

    from imu_workbench.web.access import is_local
    from imu_workbench.web.bag_root import BagRoot
    from imu_workbench.web.server import Start, bind, name_in_address, run_server

    effect_catalogue(options.effects)  # refused now rather than in every tab
    remap = topic_remap(options)
    own = [s for case in cases_in(cases) for s in load_case(case).sources] if cases else []
    root = BagRoot.of(bags or [p for s in own if (p := Path(s)).exists()], options.root)
    case = cases if cases and is_case(cases) else None
    folder = (
        case.absolute().parent if case else cases or options.case or default_cases(root.folder)
    )
    model = read_model(options.model) if options.model else None
    token = options.token or ('' if is_local(options.host) else secrets.token_urlsafe(16))
    listening = bind(options.host, options.port)
    port = listening.getsockname()[1]
    address = f'http://{name_in_address(options.host)}:{port}/' + (
        f'?token={token}' if token else ''
    )
    start = Start(
        bags=bags,
        case=case,
        model_text=model,
        effects=tuple(options.effects),
        remap=remap,
        local=is_local(options.host),
    )
    line = (
        f'workbench at {address} (cases in {folder}, bags below {root.folder}); Ctrl-C ends it\n'
    )
    run_server(listening, root, folder, start, token=token, ready=partial(_announce, line))
    return Answer({'address': address, 'root': str(root.folder), 'cases': str(folder)}, '')


def _announce(line: str) -> None:
    sys.stdout.write(line)
    sys.stdout.flush()


def sort_paths(paths: Sequence[Path]) -> tuple[tuple[Path, ...], Path | None]:
    """Return the bags, and the folder of cases where one was given; refuse what is not there."""
    for path in paths:
        if not path.exists():
            raise UserError(f'{path}: no such file or folder; name a bag or the folder of a case')
    cases = [p for p in paths if p.is_dir() and cases_in(p) and not (p / 'metadata.yaml').exists()]
    if cases and len(paths) > 1:
        raise UserError(
            f'{cases[0]}: a case is served by itself, not beside {len(paths) - 1} other paths; '
            'open further bags on the page'
        )
    if cases and is_case(cases[0]):
        load_case(cases[0])
    return tuple(path.absolute() for path in paths if path not in cases), next(iter(cases), None)


def default_cases(root: Path) -> Path:
    """Return the folder of the cases that bags below a folder make."""
    home = os.environ.get('XDG_DATA_HOME') or Path.home() / '.local' / 'share'
    key = hashlib.sha256(str(root).encode()).hexdigest()[:8]
    return Path(home) / 'imu_workbench' / f'{root.name or "root"}-{key}'


def read_model(path: Path) -> str:
    """Return the text of a model file."""
    try:
        return path.read_text('utf-8')
    except UnicodeDecodeError:
        raise UserError(f'--model {path}: not a text file; a model file is YAML') from None
