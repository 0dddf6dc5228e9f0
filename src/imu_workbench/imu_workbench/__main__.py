# SPDX-License-Identifier: Apache-2.0
"""Command line: `python -m imu_workbench VERB` and `ros2 run imu_workbench VERB` alike.

Exit code 0: answered; 2: the user's mistake, one line on standard error; 3: a check that was made
and does not hold; 1: a bug, with its traceback. Ctrl-C ends with 130.
"""

from __future__ import annotations

import os
import signal

# One thread a process for BLAS, set before numpy is loaded: sensors and workers run side by side,
# and small matrices shared among threads cost twice the time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

if __name__ == '__main__':  # Ctrl-C before everything is imported leaves no traceback either
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))

import argparse
import io
import sys
import threading
from contextlib import suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NoReturn

from imu_recording.user_error import UserError, did_you_mean

from imu_workbench.answer import Answer, error_line, show_progress, write_json
from imu_workbench.commands import COMMANDS
from imu_workbench.outputs import refuse_to_destroy

OWN_PACKAGES = ('imu_recording', 'imu_driver', 'thermal_comp', 'orientation_filters',
                'chamber_profile', 'imu_workbench')  # fmt: skip
"""Packages of this workspace: a module of theirs that is missing is no library to install."""
AFTER_CALLBACK_S = 0.05
"""How long after a callback has lost Ctrl-C it is sent again [s]."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong with the arguments in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f'{self.prog}: {message} (see {self.prog} --help)\n')


def build_parser(verb: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of all verbs; only the module of `verb` is imported (None: all)."""
    parser = _Parser(
        prog='imu_workbench',
        description='Find, explain and remove the temperature error of MEMS IMUs.',
    )
    parser.add_argument('--version', action='version', version=_version())
    verbs = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    for name, module_name in COMMANDS.items():
        if verb not in (None, name):
            verbs.add_parser(name)
            continue
        try:
            command = import_module(f'imu_workbench.commands.{module_name}')
        except ModuleNotFoundError as error:
            if verb or not missing_library(error):
                raise
            verbs.add_parser(name, help=f'(not available: {missing_library(error)})')
            continue
        child = verbs.add_parser(
            name,
            help=command.HELP,
            description=command.HELP,
            epilog=getattr(command, 'EPILOG', None),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.arguments(child)
        child.add_argument(
            '--json', metavar='FILE', type=Path, help='also write the answer as JSON'
        )
        child.set_defaults(run=command.run)
    return parser


def _version() -> str:
    try:
        return version('imu_workbench')
    except PackageNotFoundError:
        return 'run from a tree that is not built'


def main(argv: list[str] | None = None) -> int:
    """Run one verb; return the process's exit code."""
    argv = sys.argv[1:] if argv is None else argv
    _prepare_streams()
    verb = argv[0] if argv and not argv[0].startswith('-') else None
    if verb and verb not in COMMANDS:
        near = did_you_mean(verb, COMMANDS)
        sys.stderr.write(f'imu_workbench: no verb {verb!r}{near} (see imu_workbench --help)\n')
        return 2
    try:
        return _answer(build_parser(verb).parse_args(argv))
    except SystemExit as stop:  # argparse ends the process by itself; the caller wants the code
        try:
            sys.stdout.flush()
        except BrokenPipeError:
            _discard_output()
        return stop.code if isinstance(stop.code, int) else 2
    except BrokenPipeError:  # the reader of the pipe has closed it
        _discard_output()
        return 0
    except (UserError, OSError, ModuleNotFoundError) as error:
        show_progress('')
        if not is_users(error):
            raise
        error = missing_library(error) or error
        sys.stderr.write(f'{verb}: {error_line(error)}\n')
        return 2
    except KeyboardInterrupt:
        show_progress('')
        sys.stderr.write(f'{verb}: interrupted\n')
        return 130
    except Exception as error:
        contract = sys.modules.get('thermal_comp.effects.contract')
        line = contract.line_of(error) if contract else ''
        if not line:
            raise
        show_progress('')
        sys.stderr.write(f'{verb}: an effect raises {type(error).__name__}: {error}{line}\n')
        return 2


def _prepare_streams() -> None:
    """Print '?' for characters a terminal lacks, and discard output where a stream is closed."""
    for name in ('stdout', 'stderr'):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, io.TextIOWrapper(io.BytesIO(), encoding='utf-8'))
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='replace')


def _discard_output() -> None:
    """Discard what is still buffered for a closed standard output."""
    with suppress(ValueError, OSError):  # a stream of a test has no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _answer(options: argparse.Namespace) -> int:
    if options.json and not options.json.parent.is_dir():
        raise UserError(f'--json {options.json}: there is no folder {options.json.parent}')
    refuse_to_destroy(options)
    answer: Answer = options.run(options)
    show_progress('')
    if options.json:
        write_json(answer.content, options.json)
    if answer.text:
        sys.stdout.write(answer.text.rstrip('\n') + '\n')
        sys.stdout.flush()
    return answer.exit_code


def is_users(error: Exception) -> bool:
    """Tell whether an error is the user's to mend: their input, or a file, folder, port of theirs.

    A file or module of the package itself that cannot be opened is a bug.
    """
    if isinstance(error, ModuleNotFoundError):
        return missing_library(error) is not None
    name = getattr(error, 'filename', None)
    own = Path(__file__).resolve().parents[1]
    return not (isinstance(name, str) and Path(name).resolve().is_relative_to(own))


def missing_library(error: Exception) -> UserError | None:
    """Return what to do about a library that is not installed; None where something else is wrong.

    >>> missing_library(ModuleNotFoundError("No module named 'allantools'", name='allantools'))
    UserError('needs allantools, which is not installed (pip install allantools)')
    """
    library = (getattr(error, 'name', None) or '').partition('.')[0]
    if not isinstance(error, ModuleNotFoundError) or not library or library in OWN_PACKAGES:
        return None
    return UserError(f'needs {library}, which is not installed (pip install {library})')


def run_process(argv: list[str]) -> int:
    """Run one verb as all that this process does; what ends it cannot be interrupted any more."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.unraisablehook = _interrupt_again
    try:
        return main(argv)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interrupt_again(lost: sys.UnraisableHookArgs) -> None:
    """Send Ctrl-C once more where it met a callback of Python's own, which loses it."""
    if isinstance(lost.exc_value, KeyboardInterrupt):
        threading.Timer(AFTER_CALLBACK_S, os.kill, (os.getpid(), signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(lost)


def run_verb() -> int:
    """Run the verb that the executable is named after."""
    return run_process([Path(sys.argv[0]).name, *sys.argv[1:]])


if __name__ == '__main__':
    sys.exit(run_process(sys.argv[1:]))
