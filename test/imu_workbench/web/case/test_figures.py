# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.case import CaseVersion
from imu_workbench.report.figures.modelled import FAILURE_SCALE
from imu_workbench.report.figures.palette import painted
from imu_workbench.web.case.centre import window_of
from imu_workbench.web.case.figures.failure_map import failure_figure, failure_map
from imu_workbench.web.case.figures.noise import (
    allan_figure,
    allan_variance,
    noise_allan_variance,
    noise_density,
    spectrum_figure,
)
from imu_workbench.web.case.figures.scatter import phase_figure, rate_figure, temperature_figure
from imu_workbench.web.case.figures.time_course import sample_line, time_figure, time_lines
from imu_workbench.web.case.next_experiment import profile_figure, setpoint_of
from imu_workbench.web.case.preview import preview_task
from imu_workbench.web.case.versions_panel import error_steps_figure
from imu_workbench.web.case.view import View, timeline_of
from thermal_comp.experiment.plan import PAPER_PLAN
from thermal_comp.model.values import NoiseModel

VIEW = View('accelerometer', 2)


def test_the_page_draws_the_residual_that_the_command_line_reports(fitted):
    for version in (fitted.line, fitted.lag):
        for sensor, part in version.comparison['sensors'].items():
            residual = np.concatenate([run.residual(sensor) for run in version.blocks])
            rms = np.sqrt(np.nanmean(residual**2, axis=0))
            assert rms == pytest.approx(part['residual_rms'], rel=1e-9)


def test_the_line_fails_in_the_ramps_and_the_lag_does_not(fitted):
    before, after = (failure_map(version, VIEW) for version in (fitted.line, fitted.lag))
    assert {place.phase for place, _ in before.worst(6)} <= {'ramp_up', 'ramp_down'}
    assert before.worst(1)[0][1] > 10.0
    assert after.worst(1)[0][1] < 2.0


def test_no_line_is_drawn_where_nothing_was_recorded(fitted):
    whole, *others = fitted.line.blocks
    hours = whole.time / 3600.0
    cut = replace(fitted.line, blocks=(whole.at((hours < 5.0) | (hours > 6.0)), *others))
    for line in ('modelled', 'residual'):
        y, full = (time_lines(fitted.bags, v, VIEW)[line]['y'] for v in (cut, fitted.line))
        assert y.count(None) == full.count(None) + 1


def test_a_chosen_place_is_where_the_plots_go(fitted):
    place, _ = failure_map(fitted.line, VIEW).worst(1)[0]
    view = View('accelerometer', 2, place)
    timeline = timeline_of(fitted.bags)
    low, high = timeline.span(fitted.line.blocks, place)
    assert timeline.start(place.run) <= low < high <= timeline.start(place.run) + 13.0
    assert time_figure(fitted.bags, fitted.line, view)['layout']['xaxis']['range'] == [low, high]
    names = [trace['name'] for trace in temperature_figure(fitted.line, view)['data']]
    assert str(place) in names
    frames = failure_figure(failure_map(fitted.line, view), view)['layout']['shapes']
    assert len(frames) == 1


def test_lines_keep_the_extremes_and_a_zoom_shows_every_sample(fitted):
    bag = fitted.bags[0]
    values = bag.measured('accelerometer')[:, 2]
    _, drawn = sample_line(bag, 'accelerometer', 2, (0.0, bag.duration), 100)
    assert len(drawn) < 200
    assert (np.nanmin(drawn), np.nanmax(drawn)) == (values.min(), values.max())
    time, inside = sample_line(bag, 'accelerometer', 2, (3600.0, 7200.0), 2000)
    assert len(inside) == pytest.approx(360, abs=3)
    assert time[0] == pytest.approx(3600.0, abs=11.0)
    zoomed = time_lines(fitted.bags, fitted.line, VIEW, (20.0, 21.0))
    assert max(x for x in zoomed['measured']['x'] if x is not None) < 21.1


def test_a_part_of_the_time_is_all_that_any_figure_shows(fitted):
    window = (20.0, 21.0)
    view = View('accelerometer', 2, None, window)
    time = time_figure(fitted.bags, fitted.line, view)
    assert tuple(time['layout']['xaxis']['range']) == window
    hours = time['layout']['meta']['hours']
    assert (min(hours) >= 20.0, max(hours) <= 21.0, len(hours) > 100) == (True, True, True)
    inside = time['layout']['meta']['temperature']
    for trace in temperature_figure(fitted.line, view)['data']:
        if trace['mode'] == 'markers' and trace['name'] != 'cursor':
            assert min(inside) - 0.01 <= min(trace['x'])
            assert max(trace['x']) <= max(inside) + 0.01
    drawn = (sum(len(t['x']) for t in phase_figure(fitted.line, v)['data']) for v in (VIEW, view))
    assert next(drawn) > next(drawn)


def test_the_map_has_the_colours_of_the_report(fitted):
    for version in (fitted.line, fitted.lag):
        axis = failure_figure(failure_map(version, VIEW), VIEW)['layout']['coloraxis']
        assert (axis['cmin'], axis['cmax']) == (FAILURE_SCALE['cmin'], FAILURE_SCALE['cmax'])


def test_every_figure_is_plain_data_with_units_on_its_axes(fitted):
    found = failure_map(fitted.line, VIEW)
    figures = {
        'time': time_figure(fitted.bags, fitted.lag, VIEW, fitted.line),
        'before the fit': time_figure(fitted.bags, None, VIEW),
        'temperature': temperature_figure(fitted.line, VIEW),
        'rate': rate_figure(fitted.line, VIEW),
        'spectrum': spectrum_figure(fitted.line, VIEW),
        'allan': allan_figure(fitted.line, VIEW, fitted.bags),
        'stairs': error_steps_figure(
            [
                CaseVersion('v1', None, 'line', fitted.line.errors()),
                CaseVersion('v2', 'v1', 'lag', fitted.lag.errors()),
            ]
        ),
        'profile': profile_figure(setpoint_of(PAPER_PLAN)),
    }
    for name, figure in figures.items():
        titles = [
            axis['title']['text']
            for key, axis in figure['layout'].items()
            if key.startswith('yaxis')
        ]
        assert all('[' in title for title in titles), name
    figures |= {'map': failure_figure(found, VIEW), 'phase': phase_figure(fitted.line, VIEW)}
    for theme in ('light', 'dark'):
        assert '@' not in json.dumps(painted(figures, theme), allow_nan=False)


def test_a_preview_explains_what_its_effect_made_and_a_foreign_one_does_not(fitted):
    arguments = (fitted.prepared, fitted.line.model_text)
    lag = preview_task(lambda _: None, *arguments, 'thermal_lag', 'accelerometer', None, [])
    other = preview_task(lambda _: None, *arguments, 'humidity', 'accelerometer', None, [])
    assert min(lag.share) > 0.95
    assert max(other.share) < 0.7 * min(lag.share)
    assert lag.shape['time_constant'] == pytest.approx(74.0, rel=0.2)
    assert lag.error_after < 1.05 * fitted.line.floor('accelerometer') < other.error_after
    figure = time_figure(fitted.bags, fitted.line, VIEW, None, lag)
    drawn = {trace['name']: trace for trace in figure['data']}
    left = np.array([y for y in drawn['left with thermal lag']['y'] if y is not None])
    residual = np.array([y for y in drawn['residual (block means)']['y'] if y is not None])
    assert left.std() < 0.2 * residual.std()
    names = {trace['name'] for trace in temperature_figure(fitted.line, VIEW, lag)['data']}
    assert 'thermal lag would explain' in names


def test_noise_curves_agree_with_noise_that_was_drawn():
    rng = np.random.default_rng(3)
    noise = NoiseModel(np.full(3, 2e-3), np.array([300.0]), np.full((1, 3), 5e-4))
    period, n = 20.0, 40_000
    decay = np.exp(-period / 300.0)
    steps = rng.normal(0.0, 5e-4 * np.sqrt(1.0 - decay**2), n)
    slow = np.zeros(n)
    for k in range(1, n):
        slow[k] = decay * slow[k - 1] + steps[k]
    values = slow + rng.normal(0.0, 2e-3 / np.sqrt(period), n)
    tau, variance, _ = allan_variance(values, period)
    expected = noise_allan_variance(noise, 0, tau)
    assert variance[:8] == pytest.approx(expected[:8], rel=0.2)
    frequency = np.fft.rfftfreq(n, period)[1:]
    power = 2.0 * period * np.abs(np.fft.rfft(values))[1:] ** 2 / n
    low = frequency < 5e-4
    assert power[low].mean() == pytest.approx(
        noise_density(noise, 0, frequency[low], period).mean(), rel=0.1
    )


def test_only_a_change_of_the_time_axis_is_a_zoom():
    assert window_of({'xaxis3.range[0]': 2, 'xaxis3.range[1]': 3}) == (2.0, 3.0)
    assert window_of({'xaxis.range': [1, 2]}) == (1.0, 2.0)
    assert window_of({'xaxis.autorange': True}) is None
    assert window_of({'autosize': True}) == ()
