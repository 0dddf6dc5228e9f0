# SPDX-License-Identifier: Apache-2.0
"""How often is something predicted where nothing is hidden?

Every seed is a campaign without any effect: of the kinds of `everyday.py`. What the prediction of
`auto` adds beside a line stands in one JSON line, so that an interrupted run goes on where it
stopped. A thermometer that lags is an effect: campaigns are counted apart where it leaves more
than VISIBLE of a line, in noise of one-second means.

    python benchmarks/prediction_nulls.py --seeds 1000..1200 -o .benchmarks/prediction_nulls.jsonl
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from everyday import KINDS, OWN
from imu_driver.simulation.devices import draw_device
from imu_recording.recording import ImuRecording
from imu_recording.user_error import UserError
from imu_workbench.simulate.hidden_effect import EffectToHide, hidden_campaign
from independent_simulator.campaign import draw_campaign
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.empirical import empirical_form
from thermal_comp.fitting.inputs import usable_sensors
from thermal_comp.fitting.prediction import predictive_effects
from thermal_comp.noise.of_runs import determined_noise

VISIBLE = 0.3
LINE = BiasTemperature()


def null_campaign(seed: int) -> tuple[Sequence[ImuRecording], float]:
    """Return recordings without any effect, and what their thermometer leaves of a line."""
    kind = KINDS[seed % len(KINDS)]
    if kind in OWN:
        profile, orientations, logging = OWN[kind]
        nothing = [EffectToHide('nothing')]
        device = draw_device(seed)
        campaign = hidden_campaign(
            profile, device, logging, nothing, seed=seed, orientations=orientations
        )
        return campaign.recordings, 0.0
    drawn = draw_campaign(seed, kind, hide=())
    return drawn.recordings, max(drawn.truth.thermometer_magnitude.values())


def predicted(recordings: Sequence[ImuRecording]) -> dict[str, list[str]]:
    """Return what is added beside a line, by sensor; only sensors that get something."""
    runs = prepare(recordings)
    listed = dict.fromkeys(usable_sensors(runs)[0], (LINE,))
    added = {}
    for sensor, noise in determined_noise(runs, listed)[0].items():
        effects = predictive_effects(runs, sensor, [LINE], noise, EFFECTS)
        form = empirical_form(runs, sensor, (LINE, *effects), noise)
        added[sensor] = [effect.name for effect in (*effects, *([form] if form else []))]
    return {sensor: names for sensor, names in added.items() if names}


def judge(seed: int) -> dict[str, Any]:
    """Return one row of the answer."""
    recordings, thermometer = null_campaign(seed)
    row = {'seed': seed, 'kind': KINDS[seed % len(KINDS)], 'thermometer': float(thermometer)}
    start = time.process_time()
    try:
        row['added'] = predicted(recordings)
    except UserError as error:
        row['refused'] = str(error)
    return row | {'cpu_s': round(time.process_time() - start, 2)}


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """Return how many of the answered campaigns got nothing."""
    lines = []
    for good, name in ((True, 'a thermometer that follows'), (False, 'one that lags')):
        some = [r for r in rows if 'added' in r and (r['thermometer'] < VISIBLE) == good]
        clean = sum(not row['added'] for row in some)
        lines.append(f'with {name}: nothing added in {clean} of {len(some)}')
    return '\n'.join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', default='1000..1060', metavar='A..B')
    parser.add_argument(
        '-o', '--output', type=Path, default=Path('.benchmarks/prediction_nulls.jsonl')
    )
    options = parser.parse_args()
    first, last = map(int, options.seeds.split('..'))
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.touch()
    rows = [json.loads(line) for line in options.output.read_text('utf-8').splitlines()]
    done = {row['seed'] for row in rows}
    with options.output.open('a', encoding='utf-8') as file:
        for seed in (s for s in range(first, last) if s not in done):
            rows.append(judge(seed))
            print(json.dumps(rows[-1]), file=file, flush=True)
    print(summary(rows))


if __name__ == '__main__':
    main()
