# SPDX-License-Identifier: Apache-2.0
"""The certificate takes two pages, the whole at most ten, with every run."""

import base64
import importlib.util
import re
from typing import Any

import pytest
from imu_recording.user_error import UserError
from imu_workbench.report import pdf
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.certificate.recordings import MOST_LOSSES, NOTE_CHARACTERS
from imu_workbench.report.content import report_content
from imu_workbench.report.html.certificate import ROWS_OF_A_PAGE, result_rows
from imu_workbench.report.limits import CoefficientLimit, CoefficientLimits
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit


def pages(page: str) -> list[Any]:
    """Return the sheets it is printed on; every worker imports this file, one of them prints."""
    from weasyprint import HTML

    return HTML(string=page).render().pages


@pytest.fixture(scope='module')
def content(run):
    recordings = [run('dut1', up, seed=i, cycles=3) for i, up in enumerate('xyz')]
    analysis = analyse_recordings(recordings, attitudes=False, diagnosis=False)
    return report_content(analysis, commands=['report'], versions={'GTC': '1'})


@pytest.fixture(scope='module')
def page(content) -> str:
    return pdf.printed_page(content)


def test_pages(page) -> None:
    assert len(pages(page)) <= 10
    alone = re.sub(r'<section class="(run|annex)".*?</section>', '', page, flags=re.DOTALL)
    assert len(pages(alone)) == 2


def test_the_certificate_stays_on_two_pages_when_much_was_lost(content) -> None:
    note = 'imu/data_raw: 123 damaged messages left out '.ljust(NOTE_CHARACTERS, 'x')
    certificate = content['certificates']['dut1'] | {'residuals': {}, 'allan_deviation': {}}
    found = certificate | {'losses': [f'{note} (dut1_x, dut1_y, dut1_z)'] * (MOST_LOSSES + 1)}
    page = pdf.printed_page(content | {'certificates': {'dut1': found}})
    alone = re.sub(r'<section class="annex".*?</section>', '', page, flags=re.DOTALL)
    assert alone.count(note) == MOST_LOSSES + 1
    assert len(pages(alone)) == 2


@pytest.mark.long
def test_the_certificate_stays_on_two_pages_with_many_effects(run) -> None:
    """Scale factors, misalignments and lags: the results begin on the first page."""
    every = [
        EFFECTS[name]() for name in ('bias_temperature', 'scale_factor_temperature', 'thermal_lag')
    ]
    turned = [*every, EFFECTS['misalignment_temperature']()]
    recordings = [run('dut1', up, seed=i, cycles=3) for i, up in enumerate('xyz')]
    effects = {'accelerometer': turned, 'gyroscope': [every[0], every[2]], 'magnetometer': every}
    model = fit(effects, recordings)
    analysis = analyse_recordings(recordings, {'dut1': model}, attitudes=False, diagnosis=False)
    limits = CoefficientLimits(
        {
            s: {'slope': CoefficientLimit(-1.0, 1.0, u)}
            for s, u in (('gyroscope', 'rad/s/K'), ('accelerometer', 'm/s²/K'))
        }
    )
    content = report_content(analysis, commands=['report'], versions={}, limits=limits)
    rows = result_rows(content['certificates']['dut1'])
    assert len(rows) > ROWS_OF_A_PAGE
    assert len(rows) == len({(row['sensor'], row['name']) for row in rows}) + 1  # six k_ij in two
    page = pdf.printed_page(content)
    alone = re.sub(r'<section class="(run|annex)".*?</section>', '', page, flags=re.DOTALL)
    assert len(pages(alone)) == 2


@pytest.mark.long
def test_a_page_names_its_own_device_and_no_number_that_is_not_stated(content) -> None:
    plain = content['certificates']['dut1'] | {'residuals': {}, 'allan_deviation': {}}
    other = plain | {
        'device': plain['device'] | {'name': 'dut3'},
        'laboratory': plain['laboratory'] | {'number': '2026-001'},
    }
    page = pdf.printed_page(content | {'certificates': {'dut1': plain, 'dut3': other}})
    first, second = 'Calibration certificate dut1', 'Calibration certificate dut3, no. 2026-001'
    feet = [foot_of(sheet) for sheet in pages(page)]
    assert feet[:4] == [first, first, second, second]
    assert set(feet[4:]) == {'Calibration certificates dut1, dut3'}


def foot_of(sheet) -> str:
    """Return the text at the bottom left of a page."""
    (box,) = (
        b for b in sheet._page_box.children if getattr(b, 'at_keyword', '') == '@bottom-left'
    )
    return ''.join(getattr(inner, 'text', '') for inner in box.descendants())


def test_every_run_has_its_page_and_nothing_is_dark(page) -> None:
    for axis in 'xyz':
        assert f'Annex: run dut1_{axis} of dut1' in page
    assert 'data-theme' not in page
    assert '<script' not in page


def test_the_allan_deviation_is_drawn(page, content) -> None:
    found = content['certificates']['dut1']['allan_deviation']
    (source,) = re.findall(r'base64,([^"]*)" alt="Allan deviation of dut1"', page)
    drawn = base64.b64decode(source).decode()
    lines = [line['tau'] for axes in found.values() for line in axes.values()]
    assert drawn.count('id="FillBetweenPolyCollection_') == len(lines) == 9


def test_no_caption_ends_a_page(page) -> None:
    captions = 0
    for sheet in pages(page):
        boxes = list(sheet._page_box.descendants())
        lowest = (
            max(box.position_y for box in boxes if box.element_tag == 'td')
            if any(box.element_tag == 'td' for box in boxes)
            else None
        )
        for box in boxes:
            if box.element is not None and box.element.get('class') == 'caption':
                captions += 1
                assert lowest is not None
                assert box.position_y < lowest
    assert captions > 5


def test_it_is_a_pdf(content) -> None:
    certificate = content['certificates']['dut1'] | {'residuals': {}, 'allan_deviation': {}}
    undrawn = content | {'certificates': {'dut1': certificate}}
    assert pdf.report_pdf(undrawn).startswith(b'%PDF-')


def test_a_missing_library_is_named_with_the_way_out(monkeypatch) -> None:
    known = importlib.util.find_spec
    monkeypatch.setattr(
        pdf, 'find_spec', lambda name: None if name == 'weasyprint' else known(name)
    )
    with pytest.raises(UserError, match=r'requirements-pdf\.txt'):
        pdf.check_pdf()


def test_without_a_certificate_it_says_why(content) -> None:
    nothing = content | {'certificates': {}, 'devices': [{'name': 'a', 'problem': 'no die'}]}
    with pytest.raises(UserError, match='no certificate: no die'):
        pdf.printed_page(nothing)
