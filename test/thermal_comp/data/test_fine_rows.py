# SPDX-License-Identifier: Apache-2.0
"""Fine rows hold finite values of what was measured then, and nothing of two cycles at once."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.fine_rows import fine_rows, measured_temperature
from thermal_comp.data.preparation import prepare

from imu_recording import ImuRecording

from .at_rest import still


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


def test_rows_where_cycles_meet_are_left_out_and_counted_and_odd_labels_cost_nothing() -> None:
    recording = still(4.0, 0.05)
    cycle = (recording.time // 3600).astype(np.int64)
    (run,) = prepare([replace(recording, cycle=cycle)])
    assert len(run.conditions.time) == len(recording) - 2 * 3
    assert any('120 s in gaps, half-empty blocks or where cycles meet' in n for n in run.notes)
    (run,) = prepare([replace(recording, cycle=np.arange(len(recording)))])
    assert len(run.conditions.time) == len(recording)


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


def test_a_slow_thermometer_beside_fast_samples_looks_like_no_rate_effect() -> None:
    true = still(0.5, 20.0)
    held = 60 * (np.arange(len(true)) // 60)  # a sample each 3 s, held in between
    slow = replace(true, temperature=true.temperature[held], temperature_stamp=true.stamp[held])
    wanted, found = (prepare([r], period=20.0)[0] for r in (true, slow))
    fastest = 2 * np.pi / 3600.0 * 30.0  # K/s; held values are 1.5 s late on average
    inner = slice(0, -1)  # after the last sample nothing is known but its value
    late = wanted.temperature[inner] - found.temperature[inner]
    assert np.abs(late).max() < 0.02 * 1.5 * fastest


def test_a_slow_thermometer_is_recognised_where_nobody_noted_when_it_was_read() -> None:
    true = still(0.5, 1.0)
    held = 10 * (np.arange(len(true)) // 10)
    silent = replace(true, temperature=true.temperature[held])
    told = replace(silent, temperature_stamp=true.stamp[held])
    (found,), (wanted,) = prepare([silent], period=20.0), prepare([told], period=20.0)
    np.testing.assert_array_equal(found.temperature, wanted.temperature)
    assert found.conditions.temperature_interval == 10.0
    assert any('measured every 10 s' in note for note in found.notes)
    assert prepare([true])[0].conditions.temperature_interval == 0.0


def test_cycles_without_a_set_point_are_found_in_the_temperature() -> None:
    (run,) = prepare([still(3.0, 1.0)])
    assert run.has_cycles
    assert set(run.cv_group.tolist()) == {0, 1, 2, 3}  # 0: before it leaves where it began
    assert any('3 thermal cycles are found in the temperature' in note for note in run.notes)
    (ramp,) = prepare([replace(still(3.0, 1.0), temperature=np.linspace(10.0, 60.0, 10800))])
    assert not ramp.has_cycles


def test_bins_count_from_the_origin_whatever_was_cut() -> None:
    recording = still(0.1, 10.0)
    origin = int(recording.stamp[0])
    whole, _ = fine_rows(recording, origin, 1.0)
    late, _ = fine_rows(recording.rows(slice(34, None)), origin, 1.0)
    np.testing.assert_array_equal(late.stamp, whole.stamp[3:])
    np.testing.assert_array_equal(late.temperature[1:], whole.temperature[4:])


def test_after_its_last_measurement_a_temperature_goes_on_as_before() -> None:
    recording = still(0.5, 1.0)
    ramp = replace(recording, temperature=20.0 + 0.01 * recording.time)
    read = np.minimum(np.arange(len(ramp)) // 20 * 20, 1600)  # the last 3 min were not measured
    held = replace(ramp, temperature=ramp.temperature[read], temperature_stamp=ramp.stamp[read])
    found = measured_temperature(held).temperature
    np.testing.assert_allclose(found[:1620], ramp.temperature[:1620], atol=1e-9)
    np.testing.assert_allclose(found[1620:], ramp.temperature[1620], atol=1e-9)


def test_a_held_temperature_is_interpolated_between_its_measurements() -> None:
    recording = still(0.5, 1.0)
    measured = np.arange(len(recording)) // 20 * 20
    held = replace(
        recording,
        temperature=recording.temperature[measured],
        temperature_stamp=recording.stamp[measured],
    )
    off = [
        np.abs(r.temperature - recording.temperature)[:-20]
        for r in (held, measured_temperature(held))
    ]
    assert off[1].max() < 0.02 * off[0].max()
