# SPDX-License-Identifier: Apache-2.0
"""What is cut and left out of a recording before anything is fitted."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare

from imu_recording import RecordingError

from .at_rest import GRAVITY, still


def test_the_common_factor_of_a_filter_filling_up_is_cut_and_nothing_else() -> None:
    clean = still(0.5, 50.0)
    factor = np.minimum(0.54 + 0.02 * np.arange(len(clean)) / 1.0, 1.0)[:, None]
    started = replace(
        clean,
        linear_acceleration=clean.linear_acceleration * factor,
        magnetic_field=clean.magnetic_field * factor,
    )
    (run,) = prepare([started])
    assert any('start-up transient cut: ' in note for note in run.notes)
    reference = prepare([clean])[0]
    assert not any('start-up' in note for note in reference.notes)
    np.testing.assert_allclose(
        run.measured['accelerometer'][1:], reference.measured['accelerometer'][1:]
    )
    assert run.measured['accelerometer'][0, 2] == pytest.approx(GRAVITY, rel=1e-3)


def test_a_slow_start_up_leaves_no_tail() -> None:
    clean = still(2.0, 0.2)
    factor = 1.0 - 0.46 * np.exp(-clean.time / 120.0)[:, None]
    started = replace(
        clean,
        linear_acceleration=clean.linear_acceleration * factor,
        magnetic_field=clean.magnetic_field * factor,
    )
    (run,) = prepare([started])
    left = GRAVITY * 0.46 * np.exp(-run.conditions.time[0] / 120.0)
    assert 0.0 < left < 5e-4
    assert run.conditions.time[0] < 3000.0
    assert not any('start-up' in note for note in prepare([clean])[0].notes)


def test_a_motion_at_the_start_is_no_start_up() -> None:
    clean = still(0.5, 50.0)
    force = clean.linear_acceleration.copy()
    force[:100] = [GRAVITY, 0.1, 0.5]
    (run,) = prepare([replace(clean, linear_acceleration=force)])
    assert not any('start-up' in note for note in run.notes)


def test_no_temperature_at_all_is_one_clear_error() -> None:
    recording = still(0.1, 1.0, temperature=np.full(360, np.nan))
    with pytest.raises(RecordingError, match='no sample has a die temperature'):
        prepare([recording])


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('linear_acceleration', 30.0),
        ('angular_velocity', 30.0),
        ('magnetic_field', 9e-3),
        ('temperature', 150.0),
    ],
)
def test_single_damaged_values_spoil_no_block(field: str, value: float) -> None:
    clean = still(1.0, 10.0)
    values = getattr(clean, field).copy()
    values[(9000, 1) if values.ndim > 1 else 9000] = value
    wanted, found = prepare([clean])[0], prepare([replace(clean, **{field: values})])[0]
    for sensor, noise in (('accelerometer', 1e-2), ('gyroscope', 1e-4), ('magnetometer', 1e-7)):
        shift = np.abs(found.measured[sensor] - wanted.measured[sensor])
        assert shift.max() < 0.2 * noise
    assert np.abs(found.temperature - wanted.temperature).max() < 0.02
    assert any(f'{field}: 1 of 36000 rows far from both neighbours' in n for n in found.notes)
    assert not any('far from' in note for note in wanted.notes)


def test_what_stands_still_is_left_out_of_the_blocks() -> None:
    clean = still(2.0, 10.0)
    half = len(clean) // 2
    swing = 20.0 + 15.0 * np.sin(2.0 * np.pi * clean.time / 3600.0)
    force = clean.linear_acceleration.copy()
    force[half:] = force[half]
    frozen = np.where(clean.time < 1800.0, swing, swing[clean.time >= 1800.0][0])
    (run,) = prepare([replace(clean, linear_acceleration=force)])
    assert any(f'linear_acceleration: {half - 1} of 72000 rows repeat' in n for n in run.notes)
    known = np.isfinite(run.measured['accelerometer']).all(axis=1)
    assert known.mean() == pytest.approx(0.5, 0.02)
    (run,) = prepare([replace(clean, temperature=frozen, chamber_temperature=swing)])
    assert any(': temperature: ' in n and 'rows repeat one value' in n for n in run.notes)
    assert run.conditions.time[-1] == pytest.approx(1800.0, abs=5.0)


def test_a_temperature_that_is_always_the_same_is_no_missing_one() -> None:
    clean = still(1.0, 1.0)
    constant = replace(clean, temperature=np.full(len(clean), 25.0))
    (run,) = prepare([replace(constant, chamber_temperature=clean.temperature)])
    assert np.ptp(run.temperature) == 0.0


def test_time_and_memory_follow_the_samples_not_the_span() -> None:
    clean = still(1.0, 1.0)
    late = np.arange(len(clean)) >= 2400
    (run,) = prepare(
        [replace(clean, stamp=clean.stamp + late * 400 * 86_400_000_000_000)], period=20.0
    )
    assert run.slot[-1] < 2400 // 20
    assert any('samples: stamps jump 1 time, by 1.1 years: 1200 of' in n for n in run.notes)
