# SPDX-License-Identifier: Apache-2.0
"""Results of a fleet as a Parquet dataset: one row a device × sensor × axis × effect.

`DIR/results/lot=A/part-….parquet`. A file is written beside its place and moved there: it is whole
or absent. A device that was estimated again stands in a newer file; readers take its newest rows.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from imu_recording.user_error import UserError

RESULTS_FOLDER = 'results'
SCHEMA = 4
ResultRow = dict[str, Any]
"""One row; absent columns are null."""

COLUMN_TYPES: dict[str, str] = {
    'device': 'string',
    'type': 'string',
    'sensor': 'string',
    'axis': 'string',
    'effect': 'string',
    'role': 'string',
    'unit': 'string',
    'coefficients': 'list<double>',
    'std': 'list<double>',
    'run_coefficients': 'list<double>',
    'forms': 'list<string>',
    'gain': 'list<double>',
    'shapes': 'list<double>',
    'degrees': 'int64',
    'probability': 'double',
    'measured_rms': 'double',
    'held_out_rms': 'double',
    'noise_floor': 'double',
    'block_run': 'list<int16>',
    'block_share': 'list<double>',
    'block_temperature': 'list<double>',
    'block_mean': 'list<double>',
    'block_variance': 'list<double>',
    'block_seconds': 'list<double>',
    'measured_at': 'int64',
    'source': 'string',
    'fingerprint': 'string',
    'input_hash': 'string',
    'settings': 'string',
    'version': 'string',
    'written': 'int64',
    'reason': 'string',
}
"""Column → type. `role`: 'fitted' (coefficients, their standard deviations, those of each run
alone, block means by temperature and share of the time that was spent there), 'candidate'
(whitened sum of squares an effect would take up, per form; shape parameter, coefficient and its
deviation in each where it has one of either), 'diagnosed' (probability), 'failed' (reason),
'replaced' (the device moved elsewhere; no query sees it)."""


def arrow_schema() -> Any:
    """Return the schema of a file of results."""
    import pyarrow as pa

    plain = {
        'string': pa.string(),
        'double': pa.float64(),
        'int64': pa.int64(),
        'list<double>': pa.list_(pa.float64()),
        'list<string>': pa.list_(pa.string()),
        'list<int16>': pa.list_(pa.int16()),
    }
    return pa.schema([(name, plain[kind]) for name, kind in COLUMN_TYPES.items()])


def write_rows(folder: Path, rows: Sequence[ResultRow], written: int) -> None:
    """Add rows (each with its `lot`) to the dataset; `written` [ns] makes them the newest."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    lots: dict[str, list[ResultRow]] = defaultdict(list)
    for row in rows:
        own = {key: value for key, value in row.items() if key != 'lot'}
        lots[row['lot']].append({**own, 'written': written})
    for lot, own_rows in lots.items():
        home = folder / RESULTS_FOLDER / f'lot={quote(lot, safe="")}'
        partial = home / f'.part-{written}.partial'
        try:
            home.mkdir(parents=True, exist_ok=True)
            content = pa.Table.from_pylist(own_rows, arrow_schema())
            pq.write_table(content, partial, compression='zstd')
            partial.replace(home / f'part-{written}.parquet')
        except OSError as error:
            raise UserError(
                f'{home}: {os.strerror(error.errno) if error.errno else error}; mend that and run '
                'again: what is written is not done twice'
            ) from None


class FleetTable:
    """The newest rows of every device, queried with SQL as `results`."""

    def __init__(self, folder: Path) -> None:
        import duckdb

        if not any((folder / RESULTS_FOLDER).glob('*/*.parquet')):
            raise UserError(f'{folder}: no results here; `fleet SOURCE… -o {folder}` writes them')
        self.folder = folder
        self._database = duckdb.connect(config={'threads': 2, 'memory_limit': '1GB'})
        pattern = str(folder / RESULTS_FOLDER / '*' / '*.parquet').replace("'", "''")
        # Files of an earlier version may lack columns: they are null.
        self._database.register('every_column', arrow_schema().empty_table())
        try:
            self._database.execute(self._views(pattern))
        except duckdb.Error as error:
            raise UserError(
                f'{folder / RESULTS_FOLDER}: cannot be read ({str(error).splitlines()[0]}); '
                'delete the file that is named, its devices are estimated again'
            ) from None

    @staticmethod
    def _views(pattern: str) -> str:
        return f"""
            CREATE VIEW everything AS
              SELECT * FROM read_parquet('{pattern}', hive_partitioning = true, filename = true,
                                         union_by_name = true, hive_types = {{'lot': VARCHAR}})
              UNION ALL BY NAME SELECT * FROM every_column;
            CREATE TABLE newest AS SELECT source, max(written) AS written,
              max_by(filename, (written, filename)) AS filename FROM everything GROUP BY source;
            CREATE VIEW results AS SELECT everything.* EXCLUDE (filename) FROM everything
              JOIN newest USING (source, written, filename) WHERE role <> 'replaced'
            """  # noqa: S608 (the pattern is quoted)

    def rows(self, query: str, **values: Any) -> list[tuple[Any, ...]]:
        """Return the rows of a query over `results`; $name takes its value."""
        found: list[tuple[Any, ...]] = self._database.execute(query, values).fetchall()
        return found

    def columns(self, query: str, **values: Any) -> Mapping[str, Any]:
        """Return the columns of a query as numpy arrays, by name."""
        return dict(self._database.execute(query, values).fetchnumpy())


def finished(folder: Path) -> dict[str, tuple[str, ...]]:
    """Return fingerprint, settings, version, lot and type of what is done, by source."""
    if not any((folder / RESULTS_FOLDER).glob('*/*.parquet')):
        return {}
    query = """SELECT source, any_value(fingerprint), any_value(settings), any_value(version),
                      any_value(lot), any_value(type) FROM results GROUP BY source"""
    return {key: tuple(state) for key, *state in FleetTable(folder).rows(query)}


def in_several_places(folder: Path) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return devices that were estimated in several sources, each with (source, lot)."""
    if not any((folder / RESULTS_FOLDER).glob('*/*.parquet')):
        return []
    found: dict[str, list[tuple[str, str]]] = defaultdict(list)
    query = """SELECT DISTINCT device, source, lot FROM results WHERE role = 'fitted'
               AND device IN (SELECT device FROM results WHERE role = 'fitted'
                              GROUP BY device HAVING count(DISTINCT source) > 1) ORDER BY ALL"""
    for device, source, lot in FleetTable(folder).rows(query):
        found[device].append((source, lot))
    return list(found.items())


def compact(folder: Path) -> None:
    """Write the newest rows of a lot into one file where it has many, then drop the others.

    Interrupted in between, old files stand beside the new one with the same rows: readers take
    each device from one file, and the next call deletes them.
    """
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.dataset as ds
    import pyarrow.parquet as pq

    for home in sorted((folder / RESULTS_FOLDER).glob('lot=*')):
        for left in home.glob('.part-*.partial'):
            left.unlink()
        parts = sorted(home.glob('part-*.parquet'))
        if len(parts) < 2:
            continue
        table = ds.dataset(parts, schema=arrow_schema()).to_table()
        newest = table.group_by('source').aggregate([('written', 'max')])
        keys = dict(
            zip(newest['source'].to_pylist(), newest['written_max'].to_pylist(), strict=True)
        )
        wanted = pa.array([keys[source] for source in table['source'].to_pylist()])
        kept = table.filter(pc.equal(table['written'], wanted))
        partial = home / '.part-whole.partial'
        pq.write_table(kept, partial, compression='zstd')
        partial.replace(parts[-1])  # the last name: of rows that stand twice, these are read
        for part in parts[:-1]:
            part.unlink()
