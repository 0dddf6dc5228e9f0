# SPDX-License-Identifier: Apache-2.0
"""Verdicts follow from the numbers, on cases whose answer is known."""

import doctest

import numpy as np
import pytest
from imu_workbench.report.attitude import COLUMNS, FilterAttitude
from imu_workbench.report.claims import model as claims_model
from imu_workbench.report.claims.attitude import attitude_claims
from imu_workbench.report.claims.model import rejected
from imu_workbench.report.claims.thermal import (
    device_claim,
    orientation_claim,
    overheating_claim,
    pooled_claim,
    range_claim,
)

BYTES = {'ahrs': 700, 'complementary': 200}


def attitude(name: str, data: str, std: float, mean: float, cost: float) -> FilterAttitude:
    columns = dict.fromkeys(COLUMNS, std)
    means = dict.fromkeys(COLUMNS, mean)
    statistics = [{'part': 'run', 'mean': means, 'std': columns, 'largest': columns}]
    return FilterAttitude(
        filter=name,
        data=data,
        statistics=statistics,
        hours={},
        lines={},
        nanoseconds_per_sample=cost,
        flags={},
    )


def study(complementary=(4.0, 0.2), ahrs=(9.0, 1.0), half=1.5, means=(2.0, 0.1)):
    """Attitudes of one run: σ raw and compensated of both filters."""
    found = []
    for name, (raw, after), cost in (('complementary', complementary, 50), ('ahrs', ahrs, 120)):
        found += [
            attitude(name, 'raw', raw, means[0], cost),
            attitude(name, 'magnetometer compensated', half, means[0], cost),
            attitude(name, 'compensated', after, means[1], cost),
        ]
    return {'run1': tuple(found)}


def verdicts(attitudes) -> dict[str, str]:
    return {claim.key: claim.verdict for claim in attitude_claims(attitudes, BYTES)}


def test_the_papers_picture_is_supported() -> None:
    assert set(verdicts(study()).values()) == {'supported'}


def test_cycles_and_runs_have_factors_of_their_own() -> None:
    found = study()
    for one in found['run1']:
        half = {a: 0.5 * value for a, value in one.statistics[0]['std'].items()}
        if one.data == 'compensated':
            half = dict.fromkeys(half, 0.1)
        one.statistics.append({'part': 'R1', 'std': half, 'mean': half, 'largest': half})
    claim = next(c for c in attitude_claims(found, BYTES) if c.key == 'spread')
    assert [row['cycle'] for row in claim.numbers['cycles']] == ['R1', 'R1']
    assert claim.numbers['cycles'][0]['factor']['yaw'] == pytest.approx(20.0)
    assert claim.numbers['factors'][0]['factor']['yaw'] == pytest.approx(20.0)
    assert claim.numbers['factors'][1]['factor']['yaw'] == pytest.approx(9.0)
    assert 'within the cycles 6 of 6' in claim.ours


def test_each_attitude_claim_can_fail() -> None:
    assert verdicts(study(ahrs=(9.0, 9.5)))['spread'] == 'not'
    assert verdicts(study(complementary=(4.0, 0.5)))['order_of_magnitude'] == 'not'
    assert verdicts(study(means=(2.0, -3.0)))['mean'] == 'not'
    assert verdicts(study(ahrs=(3.0, 1.0)))['worse_filter'] == 'not'


def test_the_magnetometers_share_is_in_degrees() -> None:
    claim = next(c for c in attitude_claims(study(), BYTES) if c.key == 'worse_filter')
    share = claim.numbers['runs'][0]['ahrs']['magnetometer_deg']
    assert share == pytest.approx(np.sqrt(9.0**2 - 1.5**2))


def test_without_fast_recordings_nothing_is_said() -> None:
    assert set(verdicts({}).values()) == {'untestable'}


@pytest.mark.parametrize(
    ('ours', 'verdict'), [((0.3, 5.0, 100.0), 'supported'), ((0.3, 0.9, 100.0), 'not')]
)
def test_ranges_are_compared_without_start_up(ours, verdict) -> None:
    published = (0.31, 5.92, 132.01)
    ranges = {
        sensor: {'unit': 'u', 'paper': p, 'without_start_up': o, 'with_start_up': 6.0}
        for sensor, p, o in zip('gam', published, ours, strict=True)
    }
    assert range_claim(ranges).verdict == verdict
    assert range_claim({}).verdict == 'untestable'


def slopes(mean, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(mean, 0.01, (4, 3))


def test_orientation_and_devices() -> None:
    alike = {'x': slopes(1.0, 1), 'y': slopes(1.0, 2), 'z': slopes(1.0, 3)}
    bent = {'x': slopes(1.0, 1), 'y': slopes(1.3, 2), 'z': slopes(1.0, 3)}
    assert orientation_claim({'a': {'gyroscope': alike}}).verdict == 'supported'
    assert orientation_claim({'a': {'gyroscope': bent}}).verdict == 'not'
    assert orientation_claim({'a': {'gyroscope': {'x': slopes(1, 1)}}}).verdict == 'untestable'
    two = {'a': {'gyroscope': {'x': slopes(1.0, 1)}}, 'b': {'gyroscope': {'x': slopes(-1.0, 2)}}}
    found = device_claim(two)
    assert found.verdict == 'supported'
    assert '3 pairs have opposite signs' in found.ours
    assert device_claim({'a': two['a']}).verdict == 'untestable'


def test_pooling_and_overheating() -> None:
    test = {'own_rms': [[1.0] * 3] * 2, 'pooled_rms': [[5.0] * 3] * 2}
    assert pooled_claim({'g': test | {'opposite_signs': [True] * 3}}).verdict == 'supported'
    assert pooled_claim({'g': test | {'opposite_signs': [False] * 3}}).verdict == 'not'
    assert pooled_claim({}).verdict == 'untestable'
    assert overheating_claim({}).verdict == 'untestable'
    warm = overheating_claim({'r': {'die': {'mean_k': 1.5, 'std_k': 0.1}}})
    assert '1.5' in warm.ours


def test_holm_keeps_the_family() -> None:
    assert doctest.testmod(claims_model).failed == 0
    rng = np.random.default_rng(5)
    alarms = sum(rejected(rng.uniform(size=27)).any() for _ in range(2000))
    assert alarms < 40  # one family in a hundred
    assert rejected([]).tolist() == []
