# SPDX-License-Identifier: Apache-2.0
"""A known temperature error costs a filter what geometry says; compensation gives it back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import PHASES, ImuRecording
from imu_workbench.attitude_budget import (
    attitude_budget,
    budget_content,
    budget_text,
    remarks_of,
    ten_minute_drift,
    worse_angles,
)
from thermal_comp.effects import EFFECTS
from thermal_comp.model.values import SensorModel, ThermalModel

SECONDS, RATE = 120.0, 50.0


def device(rate_hz: float = RATE) -> ImuRecording:
    """A level sensor facing east that is warmed by 20 K; true attitude known."""
    rng = np.random.default_rng(1)
    n = round(SECONDS * rate_hz)
    still = np.ones((n, 1))
    return ImuRecording(
        stamp=np.arange(n) * round(1e9 / rate_hz),
        angular_velocity=1e-4 * rng.normal(size=(n, 3)),
        linear_acceleration=still * [0.0, 0.0, 9.81],
        magnetic_field=still * [0.0, 25e-6, -43e-6],
        temperature=np.linspace(20.0, 40.0, n),
        phase=np.full(n, PHASES.index('ramp_up')),
        reference_orientation=still * [0.0, 0.0, 0.0, 1.0],
    )


def warmed(true: ImuRecording) -> ImuRecording:
    """Return the recording with a field error along x and a tilt error that grow with warmth."""
    warmth = (true.temperature - 20.0)[:, None] / 20.0
    return replace(
        true,
        magnetic_field=true.magnetic_field + warmth * [5e-6, 0.0, 0.0],
        linear_acceleration=true.linear_acceleration + warmth * [0.1, 0.0, 0.0],
    )


def test_each_sensor_is_charged_with_its_own_error() -> None:
    true = device()
    result = attitude_budget(warmed(true), true)
    costs = {(c.filter, c.data): c for c in result.costs}
    grows = 1 / np.sqrt(3)  # rms of a straight line that ends at 1
    heading = np.degrees(np.arctan(5 / 25)) * grows
    tilt = np.degrees(0.1 / 9.81) * grows
    for name in ('complementary', 'ahrs'):
        raw = costs[name, 'raw'].rms
        assert raw['heading'] == pytest.approx(heading, rel=0.15)
        assert raw['inclination'] == pytest.approx(tilt, rel=0.2)
        assert costs[name, 'compensated'].rms['total'] < 0.15
        magnetometer = costs[name, 'magnetometer compensated']
        assert magnetometer.rms['inclination'] == pytest.approx(raw['inclination'], rel=0.05)
        assert magnetometer.gain['heading'] > 0.9 * raw['heading']
        assert costs[name, 'accelerometer compensated'].gain['inclination'] > 0.6 * tilt
        assert abs(costs[name, 'gyroscope compensated'].gain['total']) < 0.01
        assert magnetometer.moved['heading'] == pytest.approx(raw['heading'], rel=0.1)
        assert costs[name, 'raw'].moved['total'] < 1e-9
    assert result.against == 'reference orientation'


def test_errors_are_given_per_phase_and_temperature() -> None:
    true = device()
    result = attitude_budget(warmed(true), true, filters=['complementary'])
    groups = result.groups['complementary paper raw']
    assert [g.label for g in groups] == ['ramp_up', '20 … 30 °C', '30 … 40 °C', '40 … 50 °C']
    assert groups[1].rms['heading'] < groups[2].rms['heading'] < groups[3].rms['heading']


def test_sweep_covers_the_papers_range_below_half_the_rate() -> None:
    true = device()
    sweep = attitude_budget(warmed(true), true, filters=[]).sweep
    assert sorted({c.cutoff_hz for c in sweep}) == [2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0]
    assert {c.data for c in sweep} == {'raw', 'compensated'}


def test_slow_recordings_are_interpolated_and_it_is_said() -> None:
    true = device(rate_hz=2.0)
    result = attitude_budget(warmed(true), true, filters=['complementary'])
    assert len(result.recording) == pytest.approx(SECONDS * 50, abs=60)
    assert any('interpolated' in note for note in result.recording.notes)


def test_without_truth_the_compensated_run_stands_for_it() -> None:
    true = replace(device(), reference_orientation=None)
    result = attitude_budget(warmed(true), true, filters=['ahrs'])
    assert result.against == 'compensated run'
    costs = {c.data: c for c in result.costs}
    assert costs['compensated'].rms['total'] < 1e-9
    assert costs['raw'].rms['heading'] > 5.0


def test_remarks_carry_our_numbers() -> None:
    true = device()
    result = attitude_budget(warmed(true), true)
    found = {(r['remark'], r['unit']): r for r in remarks_of(result)}
    assert found['because of the magnetometer', 'deg']['holds']
    assert found['AHRS costs more', 'B']['holds']
    assert budget_content(result, true)['remarks'] == remarks_of(result)


def test_without_truth_no_accuracy_is_claimed() -> None:
    true = replace(device(), reference_orientation=None)
    content = budget_content(attitude_budget(warmed(true), true, filters=['ahrs']), true)
    assert {cost['rms'] for cost in content['costs']} == {None}
    assert {cost['gain'] for cost in content['costs']} == {None}
    text = budget_text(content)
    assert 'nothing is said of errors' in text
    assert 'gained' not in text
    assert "the paper's remarks:" in text
    assert 'remarks' not in budget_text({**content, 'remarks': []})  # presets are not the paper's


def test_an_angle_that_gets_worse_has_its_reason_beside_it() -> None:
    true = device()
    # The wrong way round: what is called compensated has the error.
    result = attitude_budget(true, warmed(true), filters=['ahrs'])
    (sentence,) = (s for s in worse_angles(result) if 'heading' in s)
    assert sentence in budget_text(budget_content(result, true))
    assert worse_angles(attitude_budget(warmed(true), true, filters=['ahrs'])) == []


def test_ten_minutes_are_those_of_the_removed_rate() -> None:
    true = device()
    rate = np.radians([0.0, 0.0, 0.1])  # 0.1 °/s for 600 s: 60°
    raw = replace(true, angular_velocity=true.angular_velocity + rate)
    line = SensorModel((EFFECTS['bias_temperature'](),), (np.zeros((1, 3)),), np.eye(3) * 1e-6**2)
    drift = ten_minute_drift(raw, true, ThermalModel('dut1', {'gyroscope': line}))
    assert drift is not None
    assert drift.raw_deg == pytest.approx(60.0, rel=1e-9)
    # 1e-6 rad/s/K on three axes, 0 … 20 K above the reference: rms 11.5 K.
    expected = np.degrees(1e-6 * np.sqrt(3.0) * 20.0 / np.sqrt(3.0)) * 600.0
    assert drift.compensated_deg == pytest.approx(expected, rel=0.05)
