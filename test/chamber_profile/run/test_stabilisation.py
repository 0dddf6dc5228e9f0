# SPDX-License-Identifier: Apache-2.0
"""Stabilisation, ramp rate and dwell time of one step, on temperatures with a known course."""

import numpy as np
import pytest
from chamber_profile.profile.values import Stabilisation, Step
from chamber_profile.run.stabilisation import RampRateMonitor, StabilisationMonitor, StepTimer
from chamber_profile.run.values import Readings


def first_settled(criterion: Stabilisation, course) -> float | None:
    """Time at which a temperature course meets a criterion at 20 °C [s]."""
    monitor = StabilisationMonitor(criterion)
    times = np.arange(0.0, 4000.0, 10.0)
    return next((time for time in times if monitor.settled(time, course(time), 20.0)), None)


def approach(time: float) -> float:
    """From 30 °C to 20 °C with a time constant of 600 s."""
    return 20.0 + 10.0 * np.exp(-time / 600.0)


def test_an_exponential_approach_settles_when_the_equations_say() -> None:
    in_band = 600.0 * np.log(10.0 / 0.5)
    found = first_settled(Stabilisation(band_c=0.5), approach)
    assert found == pytest.approx(in_band, abs=10.0)
    held = first_settled(Stabilisation(band_c=0.5, hold_s=300.0), approach)
    assert held == pytest.approx(in_band + 300.0, abs=20.0)
    slow = Stabilisation(band_c=5.0, max_rate_c_per_min=0.1, rate_window_s=300.0)
    mean_rate = 10.0 * (np.exp(300.0 / 600.0) - 1.0) / 5.0  # K/min over 300 s, times exp(−t/600)
    assert first_settled(slow, approach) == pytest.approx(600 * np.log(mean_rate / 0.1), abs=20.0)


def test_leaving_the_band_begins_the_hold_anew_and_no_reading_is_outside() -> None:
    monitor = StabilisationMonitor(Stabilisation(band_c=1.0, hold_s=60.0))
    course = [(0, 20.0), (50, 21.5), (60, 20.0), (100, 20.0), (110, None), (120, 20.0)]
    assert not any(monitor.settled(time, value, 20.0) for time, value in course)
    assert monitor.settled(180, 20.0, 20.0)


@pytest.mark.parametrize(('rate', 'reported'), [(2.0, None), (1.7, None), (1.5, 1.5), (2.5, 2.5)])
def test_a_ramp_more_than_a_fifth_off_its_rate_is_reported_once(rate: float, reported) -> None:
    monitor = RampRateMonitor(20.0, 50.0, 2.0)
    found = [
        monitor.deviation(time, 20.0 + rate * time / 60.0, 20.0 + 2.0 * time / 60.0)
        for time in range(0, 900, 10)
    ]
    seen = [value for value in found if value is not None]
    assert seen == ([] if reported is None else [pytest.approx(reported)])


def test_the_ends_of_a_ramp_do_not_count() -> None:
    monitor = RampRateMonitor(50.0, 20.0, 2.0)
    for time in range(0, 90, 10):  # lagging at first
        assert monitor.deviation(time, 50.0, 50.0 - 2.0 * time / 60.0) is None


@pytest.mark.parametrize(
    ('mode', 'dwelt', 'discarded'),
    [('free', 30.0, 0.0), ('guaranteed', 20.0, 0.0), ('restart', 10.0, 10.0)],
)
def test_the_dwell_clock_out_of_the_band(mode: str, dwelt: float, discarded: float) -> None:
    criterion = Stabilisation(band_c=1.0)
    step = Step('hot', 'dwell', 50.0, 2.0, dwell_s=30.0, dwell_mode=mode, stabilise=criterion)
    timer = StepTimer(step, 50.0, 0.0)
    lost = [timer.dwell(10.0, Readings(0.0, air=air)) for air in (50.0, 55.0, 50.0)]
    assert timer.dwelt_s == dwelt
    assert sum(lost) == discarded
    assert timer.dwell_complete == (mode == 'free')


def test_a_timeout_names_source_band_and_target() -> None:
    criterion = Stabilisation(source='device', band_c=0.5, timeout_s=600.0)
    timer = StepTimer(Step('cold', 'dwell', -10.0, 2.0, stabilise=criterion), -10.0, 100.0)
    assert timer.timeout_reason(699.0) == ''
    assert timer.timeout_reason(700.0) == 'device not within 0.5 K of -10 °C after 600 s'
    later = timer.after_interruption(-10.0, 650.0, settling=True)
    assert later.timeout_reason(700.0) == ''
