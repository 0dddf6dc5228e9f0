# SPDX-License-Identifier: Apache-2.0
"""What every hypothesis allows for: a thermometer that lags, slow noise beyond the fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.diagnosis.evidence.nuisances import nuisance_priors

from imu_recording import ImuRecording

from ...campaign import PERIOD, SLOPES, chamber, lagging, measured_by, run
from ..one_run import behind, lagging_gyroscope, searched


def test_the_alternatives_are_all_there_are_and_each_doubts_the_thermometer() -> None:
    hypotheses = lagging_gyroscope().hypotheses
    alternatives = nuisance_priors(hypotheses.design, hypotheses.thermometer)
    assert np.exp([probability for probability, _ in alternatives]).sum() == pytest.approx(1.0)
    for _, allowed in alternatives:
        assert allowed[0].shared
        assert allowed[0].columns == hypotheses.thermometer.columns
        assert all((prior.deviation >= 0.0).all() for prior in allowed)


def test_more_slow_noise_is_the_same_directions_wider() -> None:
    hypotheses = lagging_gyroscope().hypotheses
    alternatives = nuisance_priors(hypotheses.design, hypotheses.thermometer)
    slow = [allowed[1] for _, allowed in alternatives if len(allowed) > 1]
    assert len({prior.columns for prior in slow}) == 1
    widths = sorted(float(prior.deviation.sum()) for prior in slow)
    assert widths[0] < widths[-1]
    ratios = [prior.deviation / slow[0].deviation for prior in slow]
    place = 1.0 + np.arange(len(ratios[0]))
    assert ratios[-1] * place == pytest.approx(np.full(len(place), np.sqrt(15.0 / 3.0)))


def explained_share(slope: float) -> float:
    """Return the share of a lag's rows that the thermometer explains, where axes have a slope."""
    answer = searched(slope * behind(1e9) + 2e-3 * behind(20.0))
    return answer.hypotheses.explained_by_thermometer / answer.hypotheses.design.chi_square


def test_a_lag_is_the_thermometers_where_it_goes_with_the_slope() -> None:
    assert explained_share(2e-3) > 0.6
    assert explained_share(0.0) < 0.1


def stuck(values: np.ndarray, half_width: float) -> np.ndarray:
    """Return what a thermometer with hysteresis reads."""
    read, shown = values[0], []
    for value in values:
        read = np.clip(read, value - half_width, value + half_width)
        shown.append(read)
    return np.array(shown)


def test_a_die_that_moves_while_its_thermometer_stands_is_no_effect() -> None:
    time, temperature, _, _ = chamber()
    control = 0.9 * np.sin(2.0 * np.pi * time / 180.0)
    die = temperature + lagging(control, 200.0, PERIOD)
    read = stuck(die, 0.15)  # more than is assumed
    unseen = np.outer(die - temperature, SLOPES['linear_acceleration'])
    plain = run(error={'linear_acceleration': unseen})
    air = temperature + 200.0 * np.gradient(temperature, time) + control
    noisy = read + np.random.default_rng(1).normal(0.0, 0.02, len(read))
    campaign = [replace(plain, temperature=noisy, chamber_temperature=air)]
    diagnosis = diagnose(measured_by(campaign, 'accelerometer'))
    assert [f.name or f.kind for f in diagnosis.findings if f.sensor == 'accelerometer'] == []


def test_a_board_thermometer_that_is_fixed_anew_for_each_pose_tells_another_time() -> None:
    """Beside a die thermometer that lags by 25 s and sticks it is the best there is."""
    _, die, _, _ = chamber()
    read = stuck(lagging(die, 25.0, PERIOD), 0.1)
    steep = {'linear_acceleration': np.outer(die - 20.0, 2.0 * SLOPES['linear_acceleration'])}
    campaign = []
    for seed, (up, behind_board) in enumerate([('-x', 5.0), ('-z', 19.0), ('-y', 12.0)], start=20):
        noise = np.random.default_rng(seed).normal(0.0, 0.02, len(read))
        board = lagging(die, behind_board, PERIOD)
        plain = run(up, seed=seed, error=steep, noise=0.3)
        campaign.append(replace(plain, temperature=read + noise, device_temperature=board))
    diagnosis = diagnose(measured_by(campaign, 'accelerometer'))
    assert [f.name or f.kind for f in diagnosis.findings if f.sensor == 'accelerometer'] == []


def test_a_die_that_warms_itself_shows_where_its_thermometer_stands_before_a_ramp() -> None:
    # A die only in the air would leave it in the middle of its hysteresis until then.
    time, temperature, _, _ = chamber()
    die = temperature + 0.6 * (1.0 - np.exp(-time / 150.0))
    noisy = np.random.default_rng(8).normal(0.0, 0.03, len(die))
    read = np.round((stuck(lagging(die, 20.0, PERIOD), 0.14) + noisy) / 0.0625) * 0.0625
    error = {'linear_acceleration': np.outer(die - temperature, SLOPES['linear_acceleration'])}
    plain = [run(up, seed=70 + k, noise=0.1, error=error) for k, up in enumerate(('+x', '-z'))]
    air = temperature + 200.0 * np.gradient(temperature, time)
    campaign = [replace(one, temperature=read, chamber_temperature=air) for one in plain]
    said = diagnose(measured_by(campaign, 'accelerometer')).explanations[0]
    assert said.names == ()
    assert said.probability > 0.5


def test_what_a_better_thermometer_beside_it_tells_is_no_gradient() -> None:
    plain = run()
    die = plain.temperature
    read = stuck(die, 0.4) + np.random.default_rng(1).normal(0.0, 0.02, len(die))
    campaign = [replace(plain, temperature=read, device_temperature=die)]
    diagnosis = diagnose(measured_by(campaign, 'accelerometer'))
    assert [f.name or f.kind for f in diagnosis.findings if f.sensor == 'accelerometer'] == []


@pytest.mark.parametrize(
    'count', [0.25, *(pytest.param(k, marks=pytest.mark.long) for k in (0.1, 0.5))]
)
def test_the_steps_of_a_coarse_thermometer_are_no_effect(count: float) -> None:
    time = np.arange(0.0, 1200.0, 0.1)
    die = 22.0 + 14.0 * (1.0 - np.exp(-time / 240.0)) + 2.0 * np.sin(2.0 * np.pi * time / 400.0)
    rng = np.random.default_rng(4)
    force = 0.04 * (die - 20.0)[:, None] * [1.0, -0.8, 0.6] + [0.0, 0.0, 9.81]
    recording = ImuRecording(
        stamp=np.round(time * 1e9).astype(np.int64),
        temperature=count * np.round(die / count),
        linear_acceleration=force + 2e-3 * rng.standard_normal(force.shape),
        angular_velocity=1e-4 * rng.standard_normal(force.shape),
        magnetic_field=np.full_like(force, np.nan),
        device='board',
        up_axis='+z',
    )
    diagnosis = diagnose([recording])
    assert diagnosis.verdict == 'complete'
    assert diagnosis.explanations[0].names == ()
    assert diagnosis.explanations[0].probability > 0.8


@pytest.mark.parametrize(('size', 'names'), [(0.0, ()), (3e-4, ('thermal_lag',))])
@pytest.mark.parametrize(
    ('count', 'noise'), [(0.5, 0.05), pytest.param(0.1, 0.15, marks=pytest.mark.long)]
)
def test_what_a_poor_thermometer_does_not_say_the_air_tells(
    size: float, names: tuple[str, ...], count: float, noise: float
) -> None:
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 2 * 86400.0, 30.0)
    draught = lagging(rng.normal(0.0, 12.0, len(time)), 900.0, 30.0)
    air = 15.0 + 5.0 * np.sin(2.0 * np.pi * time / 86400.0) + draught
    die = lagging(air, 300.0, 30.0) + 2.0
    behind_die = lagging(die, 1500.0, 30.0) - die
    force = np.outer(die - 20.0, [1e-3, -1.5e-3, 2e-3]) + [0.0, 0.0, 9.81]
    force += np.outer(size * behind_die / behind_die.std(), [1.0, -0.6, 0.8])
    recording = ImuRecording(
        stamp=np.round(time * 1e9).astype(np.int64),
        temperature=count * np.round((die + noise * rng.normal(size=len(time))) / count),
        chamber_temperature=np.round(air, 1),
        linear_acceleration=force + 2e-4 * rng.normal(size=force.shape),
        angular_velocity=np.full_like(force, np.nan),
        magnetic_field=np.full_like(force, np.nan),
        device='board',
        up_axis='+z',
    )
    said = diagnose([recording]).explanations[0]
    assert said.names == names
    assert said.probability > 0.8
