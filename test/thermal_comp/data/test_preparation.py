# SPDX-License-Identifier: Apache-2.0
"""What is cut, averaged and held out before anything is fitted."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import contiguous_parts, prepare
from thermal_comp.effects import EFFECTS

from imu_recording import ImuRecording, RecordingError

GRAVITY = 9.80665


def still(hours: float, rate_hz: float, *, seed: int = 0, **fields: object) -> ImuRecording:
    """A device at rest with z up whose temperature swings once an hour by ±30 K."""
    n = int(hours * 3600 * rate_hz)
    rng = np.random.default_rng(seed)
    time = np.arange(n) / rate_hz
    force = np.tile([0.1, -0.2, GRAVITY], (n, 1)) + 0.01 * rng.standard_normal((n, 3))
    field = np.tile([2e-5, 1e-6, -4e-5], (n, 1)) + 1e-7 * rng.standard_normal((n, 3))
    parts = {
        'stamp': np.round(time * 1e9).astype(np.int64) + 1_700_000_000_000_000_000,
        'angular_velocity': 1e-4 * rng.standard_normal((n, 3)),
        'linear_acceleration': force,
        'magnetic_field': field,
        'temperature': 20.0 + 30.0 * np.sin(2 * np.pi * time / 3600.0),
        'up_axis': '+z',
        'run': 'z',
    }
    return ImuRecording(**{**parts, **fields})


def test_block_means_keep_the_mean_and_lose_the_noise() -> None:
    recording = still(1.0, 10.0)
    (run,) = prepare([recording], period=20.0)
    measured = run.measured['accelerometer']
    assert len(run) == 180
    np.testing.assert_allclose(
        measured.mean(axis=0), recording.linear_acceleration.mean(axis=0), rtol=1e-12
    )
    assert measured.std(axis=0) == pytest.approx(0.01 / np.sqrt(200), rel=0.25)


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


def test_gaps_leave_slots_empty_and_are_told() -> None:
    whole = still(1.0, 10.0)
    time = whole.time
    (run,) = prepare([whole.rows((time < 1000.0) | (time >= 1300.0))], period=20.0)
    assert set(range(180)) - set(run.slot.tolist()) == set(range(50, 65))
    assert any('300 s in gaps' in note for note in run.notes)
    assert run.time[50] == pytest.approx(1310.0, abs=0.1)


def test_values_that_are_not_finite_are_left_out_and_counted() -> None:
    force = still(0.5, 10.0).linear_acceleration.copy()
    force[5000] = np.nan
    force[6000, 1] = np.inf
    (run,) = prepare([still(0.5, 10.0, linear_acceleration=force)])
    assert any('2 of 18000 rows without a finite accelerometer value' in n for n in run.notes)
    assert np.isfinite(run.measured['accelerometer']).all()


@pytest.mark.parametrize('period', [1.0, 15.0])
def test_no_infinite_value_goes_on(period: float) -> None:
    """Slow rows are not averaged on the way, as fast ones are."""
    n = int(3600.0 / period)
    force = np.tile([0.0, 0.0, 9.8], (n, 1))
    force[n // 2] = np.inf
    recording = ImuRecording(
        stamp=np.arange(n) * round(period * 1e9),
        angular_velocity=np.zeros((n, 3)),
        linear_acceleration=force,
        magnetic_field=np.full((n, 3), 2e-5),
        temperature=np.linspace(0.0, 40.0, n),
        up_axis='+z',
    )
    (run,) = prepare([recording], period=20.0)
    assert not np.isinf(run.fine_measured['accelerometer']).any()


def test_a_second_that_holds_a_single_sample_at_the_end_is_left_out() -> None:
    (run,) = prepare([still(0.5, 10.0).rows(slice(0, 9_001))])
    assert run.conditions.time[-1] < 900.0
    (run,) = prepare([still(0.5, 10.0).rows(slice(0, 9_008))])
    assert run.conditions.time[-1] > 900.0


def test_a_slower_magnetometer_is_averaged_over_its_own_samples() -> None:
    recording = still(0.5, 10.0)
    field = recording.magnetic_field.copy()
    field[np.arange(len(field)) % 10 != 0] = np.nan
    (run,) = prepare([replace(recording, magnetic_field=field)], period=20.0)
    expected = np.nanmean(field[:200], axis=0)
    np.testing.assert_allclose(run.measured['magnetometer'][0], expected, rtol=1e-12)


def test_columns_are_those_of_the_samples_averaged() -> None:
    recording = still(1.0, 0.5)
    (run,) = prepare([recording], period=20.0)
    column = run.columns(EFFECTS['bias_temperature'](), 'gyroscope')
    np.testing.assert_allclose(
        column[:, 0], (recording.temperature - 20.0).reshape(-1, 10).mean(axis=1), rtol=1e-12
    )


def test_vibration_comes_from_the_raw_samples_at_fifty_hertz_and_not_below() -> None:
    fast = still(0.2, 100.0)
    shaken = fast.linear_acceleration.copy()
    half = slice(len(shaken) // 2, None)
    shaken[half] += 0.5 * np.sqrt(2) * np.sin(2 * np.pi * 13.0 * fast.time[half])[:, None]
    (run,) = prepare([replace(fast, linear_acceleration=shaken)], period=20.0)
    vibration = run.block_conditions.vibration
    assert vibration[:17] == pytest.approx(1e-4, rel=0.2)
    assert vibration[19:] == pytest.approx(0.25, rel=0.05)
    assert run.vibration[19:] == pytest.approx(0.75, rel=0.05)
    assert prepare([still(0.2, 10.0)])[0].conditions.vibration is None


def test_stamps_that_jitter_about_fifty_hertz_are_fast_enough_for_vibration() -> None:
    fast = still(0.2, 50.0)
    late = np.random.default_rng(1).integers(0, 1_000_000, len(fast))
    step = 20_050_000 * np.arange(len(fast), dtype=np.int64)
    (run,) = prepare([replace(fast, stamp=fast.stamp[0] + step + late)])
    assert run.vibration is not None


def test_cycles_are_held_out_and_without_them_twelve_blocks() -> None:
    recording = still(4.0, 0.5)
    cycle = (recording.time // 3600).astype(np.int64)
    (run,) = prepare([replace(recording, cycle=cycle)])
    assert run.has_cycles
    assert np.unique(run.cv_group).tolist() == [0, 1, 2, 3]
    (run,) = prepare([replace(recording, temperature=20.0 + 5.0 * recording.time / 3600.0)])
    assert not run.has_cycles
    assert np.unique(run.cv_group).tolist() == list(range(1, 13))
    assert any('12 contiguous blocks' in note for note in run.notes)


def test_rows_where_cycles_meet_are_left_out_and_counted_and_odd_labels_cost_nothing() -> None:
    recording = still(4.0, 0.05)
    cycle = (recording.time // 3600).astype(np.int64)
    (run,) = prepare([replace(recording, cycle=cycle)])
    assert len(run.conditions.time) == len(recording) - 2 * 3
    assert any('120 s in gaps, half-empty blocks or where cycles meet' in n for n in run.notes)
    (run,) = prepare([replace(recording, cycle=np.arange(len(recording)))])
    assert len(run.conditions.time) == len(recording)


@pytest.mark.parametrize(('blocks', 'parts'), [(3, 3), (40, 5), (70, 7), (5000, 12)])
def test_a_part_that_is_held_out_holds_enough_blocks(blocks: int, parts: int) -> None:
    assert np.unique(contiguous_parts(blocks)).tolist() == list(range(1, parts + 1))


def test_a_channel_logged_for_a_part_of_the_run_is_not_used() -> None:
    recording = still(1.0, 1.0)
    heater = np.ones(len(recording))
    heater[:30] = np.nan
    (run,) = prepare([replace(recording, heater=heater)])
    assert np.isfinite(run.conditions.heater).all()
    heater[:1800] = np.nan
    (run,) = prepare([replace(recording, heater=heater)])
    assert run.conditions.heater is None
    assert any('heater is known in 50% of the run only' in note for note in run.notes)


def test_no_temperature_at_all_is_one_clear_error() -> None:
    recording = still(0.1, 1.0, temperature=np.full(360, np.nan))
    with pytest.raises(RecordingError, match='no sample has a die temperature'):
        prepare([recording])


def test_a_slow_thermometer_beside_fast_samples_looks_like_no_rate_effect() -> None:
    true = still(0.5, 20.0)
    held = 60 * (np.arange(len(true)) // 60)  # a sample each 3 s, held in between
    slow = replace(true, temperature=true.temperature[held], temperature_stamp=true.stamp[held])
    wanted, found = (prepare([r], period=20.0)[0] for r in (true, slow))
    fastest = 2 * np.pi / 3600.0 * 30.0  # K/s; held values are 1.5 s late on average
    inner = slice(0, -1)  # after the last sample nothing is known but its value
    late = wanted.temperature[inner] - found.temperature[inner]
    assert np.abs(late).max() < 0.02 * 1.5 * fastest


def test_cycles_without_a_set_point_are_found_in_the_temperature() -> None:
    (run,) = prepare([still(3.0, 1.0)])
    assert run.has_cycles
    assert set(run.cv_group.tolist()) == {0, 1, 2, 3}  # 0: before it leaves where it began
    assert any('3 thermal cycles are found in the temperature' in note for note in run.notes)
    (ramp,) = prepare([replace(still(3.0, 1.0), temperature=np.linspace(10.0, 60.0, 10800))])
    assert not ramp.has_cycles


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


def test_runs_of_one_campaign_have_blocks_of_one_length() -> None:
    long, short = still(3.0, 1.0), still(0.25, 10.0, seed=1, run='short')
    runs = prepare([long, short])
    assert [run.period for run in runs] == [20.0, 20.0]
    assert len(runs[1]) == 45
    alone = prepare([short])[0]
    assert alone.period == pytest.approx(2.0)
    np.testing.assert_allclose(
        runs[1].measured['gyroscope'],
        alone.measured['gyroscope'].reshape(45, 10, 3).mean(axis=1),
        rtol=0.0,
        atol=1e-12,
    )


def test_bursts_an_hour_apart_have_the_blocks_of_what_was_sampled() -> None:
    whole = still(5.0, 20.0)
    (bursts,) = prepare([whole.rows(whole.time % 3600.0 < 45.0)])
    (alone,) = prepare([still(225.0 / 3600.0, 20.0)])
    assert bursts.period == alone.period == 0.5
    assert len(bursts) == pytest.approx(len(alone), abs=10)
    day = still(60.0, 1.0)
    (sparse,) = prepare([day.rows(day.time % 3600.0 < 5.0)])
    assert (sparse.slot[-1] + 1) <= 110_000
