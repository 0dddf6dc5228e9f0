# SPDX-License-Identifier: Apache-2.0
"""Check published tables of statistics for what cannot be."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from imu_workbench.answer import CHECK_FAILED, Answer
from imu_workbench.tables.check import TableFinding, check_rows, read_table

HELP = 'Find what cannot be in published tables of minimum, maximum, mean and σ.'
EPILOG = 'example:\n  python -m imu_workbench check-tables tables.csv --json found.json'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'table',
        metavar='CSV',
        type=Path,
        help='columns dut, quantity [unit], axis, segment, min, max, mean, std',
    )


def run(options: argparse.Namespace) -> Answer:
    """Check."""
    rows = read_table(options.table)
    findings = check_rows(rows)
    content = {
        'schema': 1,
        'verdict': 'data_quality' if findings else 'complete',
        'rows': len(rows),
        'findings': [finding.to_dict() for finding in findings],
    }
    text = '\n'.join(_lines(f'{options.table}: {len(rows)} rows', findings))
    return Answer(content, text, CHECK_FAILED if findings else 0)


def _lines(head: str, findings: Sequence[TableFinding]) -> list[str]:
    """Findings of one kind stand together; their explanations follow once."""
    if not findings:
        return [f'{head}, nothing contradicts itself']
    counts = Counter(finding.name for finding in findings)
    kinds = ', '.join(f'{name} {count}' for name, count in counts.items())
    lines = [f'{head}, {len(findings)} findings: {kinds}']
    groups: dict[tuple[str, tuple[str, ...]], list[TableFinding]] = {}
    for finding in findings:
        groups.setdefault((finding.name, finding.explanations), []).append(finding)
    for (name, explanations), members in groups.items():
        lines += [f'  {name}: {finding.text}' for finding in members]
        lines.append(f'    either {"; or ".join(explanations)}')
    return lines
