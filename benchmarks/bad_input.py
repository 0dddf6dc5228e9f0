# SPDX-License-Identifier: Apache-2.0
"""Every verb with every bad input: an answer, or one line that says what is wrong; never more.

A cell is green where the verb ends with exit code 0 and says something, or with 2 or 3 and one
line on standard error, in at most 60 s of CPU and 2 GB, without a traceback, and where what it
wrote can be read back and holds possible numbers. `--fuzz N` adds N files damaged byte by byte.

    python benchmarks/bad_input.py            # the matrix; cells done before are not run again
    python benchmarks/bad_input.py --fuzz 10000 --fresh
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import resource
import shutil
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import NoReturn

import numpy as np
from damage import INPUTS, LOGS, MODELS, Bench, fuzzed
from imu_recording.plausibility import admitted
from imu_workbench.__main__ import main as workbench
from thermal_comp.model.file import load_model

from imu_recording import read_bag

ROOT = Path(__file__).resolve().parents[1]
LONGEST_S = 60
"""CPU time of a cell: a busy machine makes none red …"""
LONGEST_WAIT_S = 300
"""… and one that waits for something is stopped."""
LARGEST_BYTES = 2 << 30
LARGEST_ADDRESS_SPACE = 8 << 30
"""What a verb may take beside what it inherits; beyond the second, a process is stopped [bytes]:
libraries reserve more than they use."""

VERBS: dict[str, tuple[str, ...]] = {
    'fit': ('fit', '{bags}', '-o', '{out}.yaml'),
    'compare': ('compare', '{bags}'),
    'compare model': ('compare', '{bags}', '--model', '{model}'),
    'apply': ('apply', '{bags}', '--model', '{model}', '-o', '{out}'),
    'diagnose': ('diagnose', '{bags}'),
    'add': ('add', 'thermal_lag', '{bags}', '-o', '{out}.yaml'),
    'auto': ('auto', '{bags}', '-o', '{out}.yaml'),
    'orient': ('orient', '{bags}', '--model', '{model}', '--preset', 'robust'),
    'report': ('report', '{bags}', '--no-attitude', '-o', '{out}.html'),
    'second-opinion': ('second-opinion', '{bags}'),
    'still': ('still', '{bags}', '-o', '{out}.yaml'),
    'export': ('export', '{model}', '{bags}', '--to', 'px4', '-o', '{out}.params'),
    'replay': (
        'replay', '{bags}', '--node', 'complementary_filter', '-p', 'cutoff_hz:=0.1', '-o', '{out}'
    ),
    'replay node': (
        'replay', '{bags}', '--node', 'thermal_comp', '-p', 'model:={model}', '-o', '{out}'
    ),
}  # fmt: skip
"""Verbs that take bags, and their arguments."""
ON_MODELS = ('compare model', 'apply', 'orient', 'export', 'replay node')
FUZZED_VERBS = {
    'fit': 0.15,
    'compare': 0.1,
    'apply': 0.25,
    'compare model': 0.1,
    'import': 0.2,
    'import log': 0.2,
}
"""How often each verb is given a damaged file."""


@dataclass(frozen=True)
class Cell:
    """What a verb did with an input."""

    input: str
    verb: str
    code: int
    seconds: float
    megabytes: float
    complaint: str
    """Why the cell is red; '' for green."""
    said: str
    """First line of what was said."""

    @property
    def mark(self) -> str:
        """The cell in the table: the exit code, '!' where it is red."""
        return f'{self.code}{"!" if self.complaint else ""}'


def run_cell(name: str, verb: str, argv: Sequence[str], folder: Path, output: Path) -> Cell:
    """Run a verb in a process of its own and judge what it did."""
    out, err = folder / 'stdout', folder / 'stderr'
    reserved, resident = _memory()
    child = os.fork()
    if not child:
        _run_and_exit(argv, out, err, reserved + LARGEST_ADDRESS_SPACE)
    _, status, usage = os.wait4(child, 0)
    seconds = usage.ru_utime + usage.ru_stime
    code = os.waitstatus_to_exitcode(status)
    said, told = (path.read_text('utf-8', errors='replace') for path in (out, err))
    size = max(usage.ru_maxrss * 1024 - resident, 0)
    complaint = _complaint(code, said, told) or _wrong_output(verb, code, output)
    if seconds > LONGEST_S or size > LARGEST_BYTES:
        complaint = complaint or f'{seconds:.0f} s, {size >> 20} MB'
    first = (told or said).strip().splitlines()
    return Cell(name, verb, code, seconds, size / 1e6, complaint, first[0][:160] if first else '')


def _memory() -> tuple[int, int]:
    """Return the address space and the resident memory of this process, which a child inherits."""
    pages = Path('/proc/self/statm').read_text('ascii').split()[:2]
    reserved, resident = (int(count) * resource.getpagesize() for count in pages)
    return reserved, resident


def _run_and_exit(argv: Sequence[str], out: Path, err: Path, largest: int) -> NoReturn:
    """Be the process that runs the verb, with `largest` bytes of address space."""
    resource.setrlimit(resource.RLIMIT_AS, (largest, largest))
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_S + 1, LONGEST_S + 1))
    signal.alarm(LONGEST_WAIT_S)
    code = 1
    try:
        with out.open('w', encoding='utf-8') as one, err.open('w', encoding='utf-8') as two:
            sys.stdout, sys.stderr = one, two
            try:
                code = workbench(list(argv))
            except BaseException:  # noqa: BLE001 (whatever comes is what is looked for)
                import traceback

                traceback.print_exc(file=two)
    finally:
        os._exit(code)


def _complaint(code: int, said: str, told: str) -> str:
    if 'Traceback' in said + told or code not in (0, 2, 3):
        last = (told.strip().splitlines() or [''])[-1]
        return f'exit code {code}: {last[:200]}'
    if code == 0 and not said.strip():
        return 'nothing said'
    if code == 2 and told.count('\n') != 1:
        return f'{told.count(chr(10))} lines on standard error'
    return ''


def _wrong_output(verb: str, code: int, output: Path) -> str:
    """Tell whether what was written cannot be read back or holds impossible numbers."""
    model = output.with_suffix('.yaml')
    try:
        if code == 2:
            return f'{model.name} was written' if model.exists() or output.exists() else ''
        if model.exists():
            load_model(model)
        if verb == 'apply' and output.exists():
            admitted(read_bag(output), ['compensated'])
    except ValueError as error:
        return f'output: {error}'
    return ''


def arguments(verb: str, bags: Sequence[Path], model: Path, output: Path) -> list[str]:
    """Return the arguments of a verb for these inputs."""
    argv: list[str] = []
    for word in VERBS[verb]:
        if word == '{bags}':
            argv += map(str, bags)
        else:
            argv.append(word.format(model=model, out=output))
    return argv


def cells_of_bags(bench: Bench, verbs: Sequence[str]) -> dict[tuple[str, str], Callable[[], Cell]]:
    """Return what runs each cell of the matrix, by input and verb."""

    def run(name: str, verb: str) -> Cell:
        bags = INPUTS[name](bench)
        bags = bags[:1] if verb.startswith('replay') else bags
        output = _fresh(bench.folder / 'out')
        argv = arguments(verb, bags, bench.model, output)
        return run_cell(name, verb, argv, bench.folder, output)

    return {(name, verb): partial(run, name, verb) for name in INPUTS for verb in verbs}


def cells_of_models(bench: Bench) -> dict[tuple[str, str], Callable[[], Cell]]:
    """Return what runs each verb that takes a model with each bad model."""

    def run(name: str, verb: str) -> Cell:
        model = bench.folder / 'bad_model.yaml'
        model.write_text(MODELS[name](bench), 'utf-8')
        output = _fresh(bench.folder / 'out')
        argv = arguments(verb, [bench.bag], model, output)
        return run_cell(name, verb, argv, bench.folder, output)

    return {(name, verb): partial(run, name, verb) for name in MODELS for verb in ON_MODELS}


MAPPING = """schema: 1
device: dut1
time: {column: t, unit: s}
columns:
  linear_acceleration: {columns: [ax, ay, az], unit: m/s²}
  angular_velocity: {columns: [gx, gy, gz], unit: rad/s}
  temperature: {column: T, unit: °C}
"""


def fuzz_case(bench: Bench, seed: int) -> Cell:
    """Damage one file byte by byte and give it to a verb."""
    rng = np.random.default_rng((seed, 13))
    verb = str(rng.choice(list(FUZZED_VERBS), p=list(FUZZED_VERBS.values())))
    output = _fresh(bench.folder / 'out')
    if verb.startswith('import'):
        of = _fuzzed_table if verb == 'import' else _fuzzed_log
        argv = of(bench, rng, output)
        return run_cell(f'fuzz {seed}', verb, argv, bench.folder, output)
    damaged = bench.folder / 'fuzzed'
    shutil.rmtree(damaged, ignore_errors=True)
    storage = str(rng.choice(['good', 'good_sqlite']))
    shutil.copytree(bench.folder / storage, damaged)
    model = bench.model
    if verb == 'compare model' and rng.random() < 0.7:
        model = bench.folder / 'fuzzed.yaml'
        model.write_bytes(fuzzed(bench.model.read_bytes(), rng))
    else:
        files = sorted(damaged.iterdir(), key=lambda file: file.suffix == '.yaml')
        file = files[int(rng.random() < 0.2)]
        file.write_bytes(fuzzed(file.read_bytes(), rng))
    argv = arguments(verb, [damaged], model, output)
    return run_cell(f'fuzz {seed}', verb, argv, bench.folder, output)


def _fuzzed_table(bench: Bench, rng: np.random.Generator, output: Path) -> list[str]:
    chosen = 'csv' if rng.random() < 0.6 else 'yaml'
    return _table(bench, output, lambda name, data: fuzzed(data, rng) if name == chosen else data)


def _fuzzed_log(bench: Bench, rng: np.random.Generator, output: Path) -> list[str]:
    suffix = str(rng.choice(list(LOGS)))
    path = bench.folder / f'fuzzed.{suffix}'
    path.write_bytes(fuzzed(bench.logs[suffix], rng))
    return ['import', str(path), '-o', str(output)]


def _table(bench: Bench, output: Path, change: Callable[[str, bytes], bytes]) -> list[str]:
    """Write a table and its mapping, each as `change` makes it; return the import's arguments."""
    run = bench.run.rows(slice(0, 200))
    columns = (run.time, run.linear_acceleration, run.angular_velocity, run.temperature)
    rows = np.column_stack(columns)
    lines = [','.join(f'{value:.9g}' for value in row) for row in rows]
    paths = {name: bench.folder / f'table.{name}' for name in ('csv', 'yaml')}
    text = '\n'.join(['t,ax,ay,az,gx,gy,gz,T', *lines, ''])
    paths['csv'].write_bytes(change('csv', text.encode()))
    paths['yaml'].write_bytes(change('yaml', MAPPING.encode()))
    return ['import', str(paths['csv']), '--mapping', str(paths['yaml']), '-o', str(output)]


def _fresh(output: Path) -> Path:
    """Return the output's path with nothing under it."""
    for path in map(output.with_suffix, ('.yaml', '.html', '.params')):
        path.unlink(missing_ok=True)
    shutil.rmtree(output, ignore_errors=True)
    return output


def prepared(folder: Path, rate: float = 1.0) -> Bench:
    """Return a bench whose good run is fitted, every fuzzed verb loaded and compiled."""
    bench = Bench(folder, rate)
    output = _fresh(folder / 'out')
    table = _table(bench, output, lambda _, data: data)
    fit = ['fit', str(bench.bag), '-o', str(bench.model), '--force']
    others = [
        arguments(verb, [bench.bag], bench.model, output) for verb in FUZZED_VERBS if verb in VERBS
    ][1:]
    for suffix, log in bench.logs.items():
        path = folder / f'good.{suffix}'
        path.write_bytes(log)
        others.append(['import', str(path), '-o', str(output / suffix), '--force'])
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        for argv in (fit, *others, [*table, '--force']):
            if workbench(argv):
                raise RuntimeError(f'the good run does not work: {argv}')
    return bench


def table(cells: Sequence[Cell]) -> str:
    """Return exit codes of input × verb, '!' where a cell is red."""
    verbs = list(dict.fromkeys(cell.verb for cell in cells))
    rows: dict[str, dict[str, Cell]] = {}
    for cell in cells:
        rows.setdefault(cell.input, {})[cell.verb] = cell
    lines = [f'{"":<28}' + ''.join(f'{verb:>15}' for verb in verbs)]
    for name, row in rows.items():
        marks = ''.join(f'{row[verb].mark if verb in row else "":>15}' for verb in verbs)
        lines.append(f'{name:<28}{marks}')
    return '\n'.join(lines)


def main() -> int:
    """Run what was not run before, print the matrix and every red cell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--fuzz', type=int, default=0, metavar='N', help='damaged files to try')
    parser.add_argument('--first-seed', type=int, default=0, help='of the damaged files')
    parser.add_argument('--fresh', action='store_true', help='forget what was run before')
    parser.add_argument('--verb', action='append', choices=tuple(VERBS), help='only these')
    parser.add_argument('-o', '--output', type=Path, default=ROOT / 'build' / 'bad_input')
    options = parser.parse_args()
    done_file = options.output / 'cells.jsonl'
    if options.fresh:
        done_file.unlink(missing_ok=True)
    bench = prepared(options.output)
    waiting = cells_of_bags(bench, options.verb or list(VERBS)) | cells_of_models(bench)
    for seed in range(options.first_seed, options.first_seed + options.fuzz):
        waiting[f'fuzz {seed}', ''] = partial(fuzz_case, bench, seed)
    done = _done(done_file)
    with done_file.open('a', encoding='utf-8') as log:
        for (name, verb), run in waiting.items():
            if (name, verb) not in done:
                cell = run()
                done[name, verb] = cell
                log.write(json.dumps([name, verb, asdict(cell)]) + '\n')
                log.flush()
                if cell.complaint:
                    print(f'RED {cell.input} × {cell.verb}: {cell.complaint}', flush=True)
    cells = [done[key] for key in waiting]
    red = [cell for cell in cells if cell.complaint]
    print(table([cell for cell in cells if not cell.input.startswith('fuzz')]))
    slowest = max(cells, key=lambda cell: cell.seconds)
    largest = max(cells, key=lambda cell: cell.megabytes)
    print(f'\n{len(cells)} cells, {len(red)} red')
    print(f'slowest {slowest.seconds:.1f} s: {slowest.input} × {slowest.verb}')
    print(f'largest {largest.megabytes:.0f} MB: {largest.input} × {largest.verb}')
    for cell in red:
        print(f'RED {cell.input} × {cell.verb}: {cell.complaint}')
    return 1 if red else 0


def _done(path: Path) -> dict[tuple[str, str], Cell]:
    if not path.exists():
        return {}
    rows = map(json.loads, path.read_text('utf-8').splitlines())
    return {(name, verb): Cell(**cell) for name, verb, cell in rows}


if __name__ == '__main__':
    sys.exit(main())
