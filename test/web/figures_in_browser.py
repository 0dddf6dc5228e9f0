# SPDX-License-Identifier: Apache-2.0
"""The figures in many hands: pointer, keyboard, finger, phone; linked, saved, read aloud."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import playwright.sync_api
import pytest
from axe_playwright_python.sync_playwright import Axe

from imu_recording import read_bag, write_bag

from .conftest import ROOT, Watched, wait_for_verdict

TIME = 'document.querySelector(\'[data-plot="error_over_time"]\')'
DRAWN = f'{TIME}?._fullLayout?.xaxis?.range[1] > 30'
FITS = """[...document.querySelectorAll('.js-plotly-plot:has(.main-svg)')].every(plot =>
  Math.abs(plot._fullLayout.width - plot.clientWidth) < 2
  && plot.clientWidth > 0.4 * (plot.closest('.card').clientWidth - 28))"""
RULES = {
    'light': ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa'],
    'dark': {'type': 'rule', 'values': ['color-contrast', 'link-in-text-block']},
}
"""What axe asks of the page in each theme; the other one changes nothing but colours."""
TALL = 1600
"""Height of a window in which all figures that a test compares are drawn [px]."""
SERIOUS = ('serious', 'critical')
STILL = """!document.querySelector('[class*="-enter-active"]')
  && document.getAnimations().every(animation => animation.playState !== 'running'
    || animation.effect.getComputedTiming().iterations === Infinity)"""
"""Nothing fades in or changes its colour: contrast is asked of what stays."""
SIGNED_CARDS = ('SVG', 'PNG', 'CSV')


def seen(page) -> dict[str, float]:
    """Return the box of the errors over time, scrolled to where a pointer reaches it."""
    area = page.locator('[data-plot="error_over_time"] .nsewdrag').first
    area.scroll_into_view_if_needed()
    return area.bounding_box()


def drag(page, first: float, last: float) -> None:
    """Brush a part of the time, given as shares of the figure's width."""
    box = seen(page)
    middle = box['y'] + box['height'] / 2
    page.mouse.move(box['x'] + first * box['width'], middle)
    page.mouse.down()
    page.mouse.move(box['x'] + last * box['width'], middle, steps=4)
    page.mouse.up()


def look_at_everything(page) -> None:
    """Leave the place that a test before this one has gone to."""
    everything = page.get_by_role('button', name='Show everything')
    if everything.is_visible():
        everything.click()
        everything.wait_for(state='hidden')


def bring(page, name: str) -> None:
    """Scroll to a figure: it is drawn where it is seen."""
    plot = page.locator(f'[data-plot="{name}"]')
    plot.scroll_into_view_if_needed()
    plot.locator('.scatterlayer').first.wait_for(state='attached')


@pytest.fixture(scope='module')
def opened_desktop(hidden_effect_server, watch_together) -> Watched:
    address = hidden_effect_server.address + '?version=v1&sensor=accelerometer&axis=z'
    watched = watch_together(address, 1280, 1000)
    watched.page.locator('.place').first.wait_for()
    wait_for_verdict(watched.page)
    watched.page.wait_for_function(DRAWN)
    return watched


@pytest.fixture
def desktop(opened_desktop) -> Watched:
    """A window that looks at everything of one axis; all tests share it."""
    look_at_everything(opened_desktop.page)
    return opened_desktop


@pytest.fixture(scope='module')
def opened_phone(hidden_effect_server, watch_together) -> Watched:
    watched = watch_together(hidden_effect_server.address, 390, 844)
    watched.page.locator('.place').first.wait_for()
    return watched


@pytest.fixture
def phone(opened_phone) -> Watched:
    """A phone that looks at everything; all tests share it."""
    look_at_everything(opened_phone.page)
    return opened_phone


@pytest.fixture
def dense_bags(tmp_path: Path) -> list[Path]:
    """Runs with far more samples than a figure has points, of a device with one sensor."""
    bags = []
    for axis in 'xyz':
        recording = read_bag(ROOT / 'bags' / f'dut1_{axis}')
        unknown = np.full((len(recording), 3), np.nan)
        bags.append(tmp_path / f'dut1_{axis}')
        write_bag(replace(recording, angular_velocity=unknown, magnetic_field=unknown), bags[-1])
    return bags


@pytest.mark.long
def test_a_brushed_time_filters_all_figures_and_survives_the_theme(serve, watch, dense_bags):
    server = serve(*dense_bags)
    watched = watch(server.address, height=TALL)
    page = watched.page
    page.locator('.place').first.wait_for()
    page.wait_for_function(DRAWN)
    points = """document.querySelector('[data-plot="residual_by_rate"]')?.data?.[0]?.x.length"""
    page.wait_for_function(f'{points} > 0')
    all_points = page.evaluate(points)
    wait_for_verdict(page)
    drag(page, 0.2, 0.25)
    page.wait_for_url('**window=**')
    span = f'(r => r[1] - r[0])({TIME}._fullLayout.xaxis.range)'
    page.wait_for_function(f'{span} < 5')
    inside = '(p => p.data[0].x.filter(v => v >= p._fullLayout.xaxis.range[0] && '
    inside += f'v <= p._fullLayout.xaxis.range[1]).length)({TIME})'
    page.wait_for_function(f'{inside} > 1000')  # the samples are back
    page.wait_for_function(f'{points} < {all_points}')
    zoomed = page.evaluate(span)
    page.get_by_role('button', name='Light / dark: switch').click()
    page.locator('body.body--dark').wait_for()
    other = page.locator('.axis:not(.on)').first
    axis = other.inner_text()[0]
    other.click()
    page.locator('.ytitle', has_text=f'error {axis}').wait_for()
    assert page.evaluate(span) == pytest.approx(zoomed, rel=1e-3)
    assert page.evaluate(inside) > 1000
    page.get_by_role('button', name='Show everything').click()
    page.wait_for_function(DRAWN)
    page.reload()
    page.locator('body.body--dark').wait_for()
    watched.check()


def test_one_cursor_goes_through_all_figures(desktop):
    page = desktop.page
    for name in ('residual_by_temperature', 'residual_by_rate'):
        bring(page, name)
    box = seen(page)
    page.mouse.move(box['x'] + 0.3 * box['width'], box['y'] + 60)
    page.mouse.move(box['x'] + 0.31 * box['width'], box['y'] + 62)
    marked = """name => {
      const plot = document.querySelector(`[data-plot="${name}"]`);
      return plot.data.find(t => t.name === 'cursor').x[0];
    }"""
    for name in ('error_over_time', 'residual_by_temperature', 'residual_by_rate'):
        page.wait_for_function(f'({marked})("{name}") !== null')
    temperature = page.evaluate(marked, 'residual_by_temperature')
    rows = page.evaluate(f'{TIME}.layout.meta')
    hour = page.evaluate(marked, 'error_over_time')
    nearest = min(range(len(rows['hours'])), key=lambda i: abs(rows['hours'][i] - hour))
    assert rows['temperature'][nearest] == pytest.approx(temperature, abs=0.5)
    page.locator('.cells button.under').wait_for(state='attached')
    desktop.check()


def test_the_buttons_of_a_figure_cover_nothing(desktop):
    page = desktop.page
    for name in ('error_over_time', 'residual_by_temperature', 'residual_by_phase'):
        plot = page.locator(f'[data-plot="{name}"]')
        plot.hover(position={'x': 200, 'y': 160})
        bar = plot.locator('.modebar').bounding_box()
        card = page.locator('.card', has=plot).last
        for other in (plot.locator('.main-svg').first, card.locator('.saves'), card.locator('h2')):
            box = other.bounding_box()
            beside = bar['x'] + bar['width'] <= box['x'] or box['x'] + box['width'] <= bar['x']
            apart = bar['y'] + bar['height'] <= box['y'] or box['y'] + box['height'] <= bar['y']
            assert beside or apart, (name, bar, box)
    desktop.check()


def test_figures_are_saved_under_names_that_say_what_they_show(desktop):
    page = desktop.page
    bring(page, 'residual_by_rate')
    card = page.locator('.card', has=page.locator('[data-plot="residual_by_rate"]')).last
    files = {}
    for format_ in SIGNED_CARDS:
        with page.expect_download() as saving:
            card.get_by_role('button', name=re.compile(f'as {format_}$')).click()
        files[format_] = saving.value
    stem = re.compile(r'dut2_v\d+_accelerometer_z_residual_by_rate\.(svg|png|csv)')
    assert all(stem.fullmatch(file.suggested_filename) for file in files.values())
    assert Path(files['SVG'].path()).read_bytes().startswith(b'<svg')
    assert Path(files['PNG'].path()).read_bytes().startswith(b'\x89PNG')
    with Path(files['CSV'].path()).open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 100
    assert rows[0]['y is'] == 'residual [m/s²]'
    card = page.locator('.card', has=page.locator('[data-plot="error_over_time"]')).last
    with page.expect_download() as saving:
        card.get_by_role('button', name=re.compile('as CSV$')).click()
    with Path(saving.value.path()).open(newline='') as file:
        rows = list(csv.DictReader(file))
    starts = page.evaluate(f'{TIME}.layout.meta.starts')
    for number, axis in enumerate('xyz'):
        hours = [float(row['x']) for row in rows if row['run'] == f'dut2_{axis}']
        assert min(hours) == pytest.approx(starts[number], abs=0.05)
        assert max(hours) < [*starts, 99.0][number + 1]
    desktop.check()


def test_a_phone_scrolls_down_only_and_a_keyboard_reaches_everything(phone):
    page = phone.page
    assert page.evaluate('document.documentElement.scrollWidth') <= 390
    page.get_by_role('button', name='Live', exact=True).click()
    page.locator('.live').wait_for()
    assert page.evaluate('document.documentElement.scrollWidth') <= 390
    page.get_by_role('button', name='Case', exact=True).focus()
    page.keyboard.press('Enter')
    page.locator('.place').first.wait_for()
    seen = set()
    for _ in range(80):
        page.keyboard.press('Tab')
        seen.add(page.evaluate("document.activeElement.className.split(' ')[0]"))
        if page.evaluate("document.activeElement.matches('.place')"):
            break
    assert {'tile', 'axis', 'place'} <= seen
    page.keyboard.press('Enter')
    page.locator('.place.on').wait_for()
    phone.check()


def test_the_map_is_walked_with_arrow_keys_and_enter_goes_there(desktop):
    page = desktop.page
    page.locator('.cells button[tabindex="0"]').focus()
    focused = page.locator('.cells button:focus')
    assert 'ramp up' in focused.get_attribute('aria-label')
    for key in ('Home', 'ArrowRight', 'ArrowDown', 'ArrowDown', 'ArrowDown'):
        page.keyboard.press(key)
    assert focused.get_attribute('aria-label').startswith('dut2_x, final: ')
    page.keyboard.press('End')
    assert focused.get_attribute('aria-label').startswith('dut2_z, final: ')
    for key in ('ArrowDown', 'ArrowUp'):  # nothing below: the focus stays where it is
        page.keyboard.press(key)
    assert focused.get_attribute('aria-label').startswith('dut2_z, dwell at ambient, cycle 1: ')
    cell, plot = focused.bounding_box(), page.locator('.map .js-plotly-plot').bounding_box()
    assert plot['x'] < cell['x'] < plot['x'] + plot['width']
    label = focused.get_attribute('aria-label').partition(':')[0]
    page.keyboard.press('Enter')
    page.locator('.legendtext', has_text=label).first.wait_for()
    page.locator('.cells button:focus[aria-selected=true]').wait_for()
    desktop.check()


@pytest.mark.long
def test_figures_follow_a_window_that_changes_its_width(phone):
    page = phone.page
    page.set_viewport_size({'width': 390, 'height': TALL})
    numbers = page.locator('.map .js-plotly-plot .textpoint')
    page.locator('.map .js-plotly-plot .heatmaplayer image').wait_for()
    assert numbers.count() == 0
    page.set_viewport_size({'width': 844, 'height': TALL})
    numbers.first.wait_for(state='attached')
    page.wait_for_function(FITS)
    page.set_viewport_size({'width': 390, 'height': TALL})
    page.wait_for_function(FITS)
    numbers.first.wait_for(state='detached')
    page.set_viewport_size({'width': 390, 'height': 844})
    phone.check()


@pytest.mark.long
def test_nothing_can_be_pressed_before_the_server_hears_it(hidden_effect_server, browser):
    page = browser.new_page()
    held = []
    page.route_web_socket('**', lambda socket: held.insert(0, socket))
    page.goto(hidden_effect_server.address)
    button = page.get_by_role('button', name='Open bags')
    button.wait_for()
    with pytest.raises(playwright.sync_api.TimeoutError):
        button.click(timeout=1000)
    assert len(held) == 1
    held[0].connect_to_server()
    button.click()
    page.get_by_role('checkbox').first.wait_for()
    page.close()


@pytest.mark.long
def test_a_finger_scrolls_over_figures_and_taps_a_cell(hidden_effect_server, watch):
    address = hidden_effect_server.address + '?version=v1&sensor=accelerometer&axis=z'
    watched = watch(address, 820, 1180, has_touch=True, is_mobile=True)
    page = watched.page
    cell = page.locator('.cells button[aria-label^="dut2_z, cold dwell, cycle 3"]')
    cell.tap()
    page.locator('[data-plot="residual_by_temperature"]').scroll_into_view_if_needed()
    page.locator('.legendtext', has_text='dut2_z, cold dwell, cycle 3').first.wait_for()
    page.wait_for_function(
        "[...document.querySelectorAll('.js-plotly-plot:has(.main-svg)')]"
        '.every(p => !p._fullLayout.dragmode)'
    )
    page.locator('.modebar-btn[data-title="Zoom in"]').first.wait_for()
    watched.check()


def test_nothing_serious_stands_in_anybodys_way(hidden_effect_server, watch):
    watched = watch(hidden_effect_server.address)
    page = watched.page
    page.locator('.place').first.wait_for()
    page.locator('.verdict:not(.waiting) .sentence').wait_for()
    page.wait_for_function(DRAWN)
    found = []
    for scheme in RULES:
        page.emulate_media(color_scheme=scheme)
        page.locator(f'body.body--{scheme}').wait_for()
        page.get_by_role('button', name='Case', exact=True).click()
        page.locator('.place').first.wait_for()
        found += serious(page, scheme)
        page.get_by_role('button', name='Open bags').click()
        page.get_by_role('checkbox').first.wait_for()
        found += serious(page, scheme, '.q-dialog')
        page.keyboard.press('Escape')
        page.locator('.q-dialog').wait_for(state='detached')
        page.get_by_role('button', name='Fleet', exact=True).click()
        page.locator('.fleet-verdict').first.wait_for()
        found += serious(page, scheme)
        page.get_by_role('button', name='Live', exact=True).click()
        page.locator('.live').wait_for()
        found += serious(page, scheme)
    assert found == []
    watched.check()


def serious(page, scheme: str, part: str = 'body') -> list[str]:
    """What axe finds serious in a part of the page as it is."""
    page.wait_for_function(STILL)
    results = Axe().run(page, context=part, options={'runOnly': RULES[scheme]})
    return [
        f'{violation["id"]}: {node["target"]} {node["failureSummary"]}'
        for violation in results.response['violations']
        if violation['impact'] in SERIOUS
        for node in violation['nodes']
    ]
