# SPDX-License-Identifier: Apache-2.0
"""Check published tables of statistics for what cannot be."""

from __future__ import annotations

import argparse
from pathlib import Path

from thermal_comp.table_check import check_rows, read_table

from imu_workbench.answer import Answer

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
    lines = [f'{options.table}: {len(rows)} rows, {len(findings)} findings']
    for finding in findings:
        lines.append(f'  {finding.name}: {finding.text}')
        lines += [f'    perhaps: {explanation}' for explanation in finding.explanations]
    content = {
        'schema': 1,
        'verdict': 'data_quality' if findings else 'complete',
        'rows': len(rows),
        'findings': [finding.content() for finding in findings],
    }
    return Answer(content, '\n'.join(lines))
