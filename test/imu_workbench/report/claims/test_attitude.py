# SPDX-License-Identifier: Apache-2.0
"""Verdicts on attitudes follow from the numbers, on cases whose answer is known."""

import numpy as np
import pytest
from imu_workbench.report.attitude import ANGLE_COLUMNS, FilterAttitude
from imu_workbench.report.claims.attitude import attitude_claims

BYTES = {'ahrs': 700, 'complementary': 200}


def attitude(name: str, data: str, std: float, mean: float, cost: float) -> FilterAttitude:
    columns = dict.fromkeys(ANGLE_COLUMNS, std)
    means = dict.fromkeys(ANGLE_COLUMNS, mean)
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
