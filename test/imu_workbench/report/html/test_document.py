# SPDX-License-Identifier: Apache-2.0
"""The report says what was put in, needs no network, and survives recordings with holes."""

import base64
import gzip
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.answer import plain
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.content import report_content
from imu_workbench.report.figures.palette import COLOURS, painted
from imu_workbench.report.html.document import report_page, report_text
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit_prepared

from imu_workbench import parallel

SLOPE = {'gyroscope': (4e-5, -2e-5, 1e-5), 'magnetometer': (2e-7, -1e-7, 3e-7)}


def content_of(recordings, **options):
    analysis = analyse_recordings(recordings, **options)
    return report_content(analysis, commands=['make demo'], versions={'numpy': '2'})


@pytest.fixture(scope='module')
def content(run):
    """Two devices with opposite slopes, two orientations each, filters included."""
    runs = [
        run(device, up, seed=10 * i + j, cycles=3)
        for i, device in enumerate(('dut1', 'dut2'))
        for j, up in enumerate('xz')
    ]
    return content_of(runs)


@pytest.fixture(scope='module')
def page(content) -> str:
    return report_page(content)


def figures_of(page: str) -> dict:
    found = re.search(r'id="figures" type="text/plain">(.*?)</script>', page, re.DOTALL)
    return json.loads(gzip.decompress(base64.b64decode(found[1])))


def test_the_slopes_put_in_come_out(content) -> None:
    for row in content['slopes']:
        if row['sensor'] in SLOPE:
            factor = {'gyroscope': 180 / np.pi, 'magnetometer': 1e6}[row['sensor']]
            sign = 1 if row['device'] == 'dut1' else -1
            wanted = sign * factor * np.array(SLOPE[row['sensor']])
            np.testing.assert_allclose(row['slope'], wanted, rtol=0.05)


def test_the_model_removes_what_temperature_did(content) -> None:
    for device in ('dut1', 'dut2'):
        for part in content['comparison'][device]['sensors'].values():
            assert max(part['residual_rms']) < 0.3 * max(part['measured_rms'])
            assert max(part['held_out_rms']) < 1.2 * max(part['noise_floor'])


def test_claims_are_judged_by_the_data(content) -> None:
    verdict = {claim['key']: claim['verdict'] for claim in content['claims']}
    assert verdict['devices'] == 'supported'
    assert verdict['pooled'] == 'supported'
    assert verdict['linear'] == 'supported'
    assert verdict['orientation'] == 'supported'
    # One sample a second says nothing about filters that want fifty: numbers, but no verdict.
    said = {claim['key']: claim['ours'] for claim in content['claims']}
    for key in ('spread', 'order_of_magnitude', 'mean', 'worse_filter'):
        assert verdict[key] == 'untestable'
        assert said[key].startswith('interpolated, so without a verdict: ')
    assert 'bytes of state' in said['cost']


def test_attitudes_of_slow_recordings_are_marked(content, page) -> None:
    assert all(run['interpolated'] for run in content['attitudes'])
    assert page.count('no verdict on these degrees') >= 4
    spread = {
        (f['filter'], f['data']): f['statistics'][0]['std']['rotation']
        for f in content['attitudes'][0]['filters']
    }
    for name in ('complementary', 'ahrs'):
        assert spread[name, 'compensated'] < 0.5 * spread[name, 'raw']


def test_cycles_and_the_whole_run_are_separate(content) -> None:
    parts = [p['part'] for p in content['attitudes'][0]['filters'][0]['statistics']]
    assert parts == ['run', 'R1', 'R2', 'R3']


def test_the_page_needs_no_network(page) -> None:
    without_library = re.sub(r'<script id="plotly".*?</script>', '', page, flags=re.DOTALL)
    loads = (r'<script[^>]+src=', r'<link[^>]+href="http', r'@import', r'url\(\s*[\'"]?http')
    for pattern in loads:
        assert not re.search(pattern, without_library), pattern
    assert len(page.encode()) < 7e6  # two devices with attitudes


def test_only_the_campaign_of_the_paper_is_held_against_it(content, page) -> None:
    words = re.compile(r'>[^<>]*(Fig\. \d|[Tt]he paper|Paper, )')
    assert not content['follows_paper']
    assert not words.search(re.sub(r'<script.*?</script>', '', page, flags=re.DOTALL))
    followed = report_page(content | {'follows_paper': True})
    for number in (1, 4, 5, 6, 7, 8):
        assert f'Fig. {number}. ' in followed
    assert 'Paper, Table VI. [°]' in followed
    assert 'Table VII. Angles on compensated data' in followed


def test_every_axis_has_a_title_with_its_unit(page) -> None:
    figures = figures_of(page)
    assert {key.split('|')[0] for key in figures} == {
        'plan', 'cycle', 'dependence', 'fit', 'residual', 'where', 'stairs', 'attitude', 'allan',
    }  # fmt: skip
    for key, figure in figures.items():
        used = {trace.get(a, a[0]) for trace in figure['data'] for a in ('xaxis', 'yaxis')}
        for name in used - {'x', 'y'} if key.startswith('where') else used:
            axis = figure['layout'][f'{name[0]}axis{name[1:]}']
            labelled = axis.get('showticklabels', True)
            text = axis['title']['text']
            if key.startswith(('dependence', 'attitude', 'where', 'stairs', 'allan')) and not text:
                continue  # the panel's title has it, or a neighbour in the same row or column
            assert not labelled or re.search(r'\[.+\]|blocks of 20 s', text), (key, name, text)


def test_colours_are_tokens_of_both_themes(page) -> None:
    assert set(COLOURS['light']) == set(COLOURS['dark'])
    tokens = set(re.findall(r'"@(\w+)"', json.dumps(figures_of(page))))
    assert tokens <= set(COLOURS['light'])
    painted_figure = painted({'line': {'color': '@x'}, 'shapes': ['@band']}, 'dark')
    assert painted_figure['line']['color'] == COLOURS['dark']['x']


def test_content_is_plain_and_the_text_short(content) -> None:
    again = json.loads(json.dumps(plain(content), allow_nan=False))
    assert again['schema'] == 1
    assert [r['name'] for r in again['recordings']] == ['dut1_x', 'dut1_z', 'dut2_x', 'dut2_z']
    text = report_text(content)
    assert 'no verdict' in text
    assert len(text.splitlines()) < 80


@pytest.mark.parametrize(
    'missing',
    [
        {'magnetic_field': 'nan'},
        {'chamber_temperature': None, 'device_temperature': None, 'setpoint': None},
        {'phase': None, 'cycle': None, 'setpoint': None},
        {'up_axis': '', 'device': '', 'run': '', 'profile': ''},
    ],
)
def test_absent_tracks_leave_parts_out(run, missing) -> None:
    recording = run()
    values = {
        name: np.full((len(recording), 3), np.nan) if value == 'nan' else value
        for name, value in missing.items()
    }
    content = content_of([replace(recording, **values)], attitudes='magnetic_field' in missing)
    page = report_page(content)
    assert 'How to reproduce' in page
    assert 'accelerometer' in content['statistics'][0]['sensors']
    assert ('magnetometer' in content['statistics'][0]['sensors']) != ('magnetic_field' in missing)


def test_a_slope_of_one_cycle_has_no_uncertainty(run) -> None:
    content = content_of([run(cycles=1)], attitudes=False, diagnosis=False)
    assert content['slopes'][0]['uncertainty'] == [None, None, None]
    table = re.search(r'Slope of the gyroscope.*?</table>', report_page(content), re.DOTALL)
    assert '0.00229' not in table[0]
    assert '2.29' in table[0]  # in thousandths


def test_a_single_temperature_gives_a_report_that_says_so(run) -> None:
    recording = run()
    flat = replace(recording, temperature=np.full(len(recording), 20.0))
    content = content_of([flat], attitudes=False)
    assert 'span of at least' in content['devices'][0]['problem']
    assert content['comparison'] == {}
    assert content['devices'][0]['problem'] in report_text(content)
    assert 'How to reproduce' in report_page(content)


def test_bags_that_name_no_device_are_told(run) -> None:
    unnamed = [replace(run(up=up, cycles=1), device='', run=up) for up in 'xz']
    content = content_of(unnamed, attitudes=False, diagnosis=False)
    assert '2 bags name no device' in report_text(content)
    assert '2 bags name no device' in report_page(content)
    alone = content_of(unnamed[:1], attitudes=False, diagnosis=False)
    assert 'name no device' not in report_text(alone)


def test_every_version_of_a_model_shows_its_error_and_degrees(run) -> None:
    recordings = [run(cycles=2)]
    prepared = prepare(recordings)
    line = fit_prepared([BiasTemperature()], prepared)
    curved = fit_prepared([BiasTemperature(), EFFECTS['bias_temperature_curvature']()], prepared)
    model = line.succeeded_by(curved)
    content = content_of(recordings, models={'dut1': model}, diagnosis=False)
    names = [version['name'] for version in content['models']['dut1']['history']]
    assert names == ['bias temperature', '+ bias temperature curvature']
    stairs = content['staircase']['dut1']
    assert stairs['versions'] == ['raw', *names]
    assert all(len(part['steps']) == 3 for part in stairs['sensors'].values())
    assert [len(row['sigma']) for row in stairs['degrees']] == [3, 3]
    assert None not in stairs['degrees'][0]['sigma']
    assert 'history of the model' in report_page(content)


def test_noise_alone_looks_calm_and_a_missing_effect_does_not(run) -> None:
    clean = run(cycles=3)
    bent = 0.02 * ((clean.temperature - 20.0) / 30.0) ** 2
    wrong = replace(clean, linear_acceleration=clean.linear_acceleration + bent[:, None])
    loudest = []
    for recording in (clean, wrong):
        content = content_of([recording], attitudes=False, diagnosis=False)
        ratios = content['residuals']['dut1_z']['accelerometer']['where']['ratio']
        loudest.append(max(map(max, ratios)))
    assert loudest[0] < 1.5
    assert loudest[1] > 2.0


def test_text_from_a_bag_cannot_break_the_page(run) -> None:
    recording = replace(run(), run='</script><b>x', device='<i>dut')
    page = report_page(content_of([recording], attitudes=False))
    assert '</script><b>x' not in page
    markup = re.sub(r'<script.*?</script>', '', page, flags=re.DOTALL)
    assert '&lt;i&gt;dut' in markup
    assert '<i>dut' not in markup


def test_workers_give_the_same_numbers(run, monkeypatch) -> None:
    monkeypatch.setattr(parallel, 'may_fork', lambda: True)
    recordings = [run(up=up, cycles=1) for up in 'xz']
    alone = content_of(recordings, diagnosis=False)
    together = content_of(recordings, diagnosis=False, workers=2)
    for a, b in zip(alone['attitudes'], together['attitudes'], strict=True):
        for f, g in zip(a['filters'], b['filters'], strict=True):
            assert f['statistics'] == g['statistics']


def test_a_recording_too_short_for_a_diagnosis_has_a_report_that_says_so(run):
    whole = run(cycles=2)
    since = (whole.stamp - whole.stamp[0]) * 1e-9
    short = whole.rows((since > 560.0) & (since < 588.0))
    content = content_of([short], attitudes=False)
    assert not content['diagnosis']
    (device,) = content['devices']
    assert 'not diagnosed: the runs are too short' in device['note']
    assert '30 are needed' in report_text(content)
    assert 'not diagnosed' in report_page(content)
