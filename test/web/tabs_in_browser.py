# SPDX-License-Identifier: Apache-2.0
"""Several tabs, a phone, a keyboard, the wheel of time: the page in other hands."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BAGS = [ROOT / 'bags' / f'hidden_effect_{axis}' for axis in 'xyz']
LINE_LENGTH = "document.querySelector('.stack .js-plotly-plot').data[0].x.length"
DRAWN = "document.querySelector('.stack .js-plotly-plot')?._fullLayout?.xaxis?.range[1] > 30"

FITS = """[...document.querySelectorAll('.js-plotly-plot')].every(plot =>
  plot._fullLayout && Math.abs(plot._fullLayout.width - plot.clientWidth) < 2
  && plot.clientWidth > 0.9 * (plot.closest('.card').clientWidth - 28))"""


def test_two_tabs_do_not_disturb_each_other_and_work_can_be_stopped(serve, watch):
    server = serve(*BAGS)
    one, other = watch(server.address), watch(server.address, color_scheme='dark')
    for watched in (one, other):
        watched.page.locator('.tile.bad').first.wait_for()
    other.page.locator('.tile', has_text='Gyroscope').click()
    other.page.locator('.tile.on', has_text='Gyroscope').wait_for()
    one.page.get_by_role('tab', name='Add').click()
    one.page.get_by_role('checkbox', name='thermal lag', exact=True).click()
    one.page.locator('tr.on', has_text='v2').wait_for()
    assert one.page.locator('.tile.on').inner_text().startswith('Accelerometer')
    assert other.page.locator('.tile.bad', has_text='Accelerometer').count() == 1

    other.page.get_by_role('tab', name='Learn').click()
    other.page.get_by_role('button', name='Diagnose').click()
    other.page.get_by_role('button', name='Cancel').click()
    other.page.locator('.job').wait_for(state='detached')
    other.page.get_by_role('button', name='Diagnose').wait_for()
    other.page.locator('.tile', has_text='Magnetometer').click()
    other.page.locator('.tile.on', has_text='Magnetometer').wait_for()
    assert server.alive
    one.check()
    other.check()


def test_zooming_brings_the_samples_back(serve, watch):
    server = serve(ROOT / 'bags' / 'dut1_x', ROOT / 'bags' / 'dut1_y', ROOT / 'bags' / 'dut1_z')
    watched = watch(server.address)
    page = watched.page
    page.locator('.place').first.wait_for()
    page.wait_for_function(DRAWN)
    whole = page.evaluate(LINE_LENGTH)
    place = page.locator('.stack .js-plotly-plot .xy .drag').first
    place.wait_for(state='attached')
    box = page.locator('.stack .js-plotly-plot .nsewdrag').first.bounding_box()
    middle = box['y'] + box['height'] / 2
    page.mouse.move(box['x'] + 100, middle)
    page.mouse.down()
    page.mouse.move(box['x'] + 130, middle, steps=4)
    page.mouse.up()
    inside = '(p => p.data[0].x.filter(v => v >= p._fullLayout.xaxis.range[0] && '
    inside += 'v <= p._fullLayout.xaxis.range[1]).length)'
    inside += "(document.querySelector('.stack .js-plotly-plot'))"
    page.wait_for_function(f'{inside} > 1000')
    span = page.evaluate(
        "(r => r[1] - r[0])(document.querySelector('.stack .js-plotly-plot')"
        '._fullLayout.xaxis.range)'
    )
    assert span < 5.0
    assert whole > 2000
    watched.check()


def test_a_phone_scrolls_down_only_and_a_keyboard_reaches_everything(hidden_effect_server, watch):
    watched = watch(hidden_effect_server.address, 390, 844)
    page = watched.page
    page.locator('.place').first.wait_for()
    for name in ('Compare', 'Learn', 'Add', 'Live'):
        page.get_by_role('tab', name=name).click()
        page.locator('.q-tab--active', has_text=name).wait_for()
        assert page.evaluate('document.documentElement.scrollWidth') <= 390, name
    page.get_by_role('tab', name='Compare').focus()
    page.keyboard.press('Enter')
    page.locator('.place').first.wait_for()
    seen = set()
    for _ in range(40):
        page.keyboard.press('Tab')
        seen.add(page.evaluate("document.activeElement.className.split(' ')[0]"))
        if page.evaluate("document.activeElement.matches('.place')"):
            break
    assert {'tile', 'axis', 'place'} <= seen
    page.keyboard.press('Enter')
    page.locator('.place.on').wait_for()
    watched.check()


def test_the_map_is_walked_with_arrow_keys_and_enter_goes_there(hidden_effect_server, watch):
    watched = watch(hidden_effect_server.address)
    page = watched.page
    page.locator('.cells button').first.wait_for()
    page.locator('.place').first.wait_for()
    for _ in range(30):
        page.keyboard.press('Tab')
        if page.evaluate("document.activeElement.matches('.cells button')"):
            break
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
    watched.check()


def test_figures_follow_a_window_that_changes_its_width(hidden_effect_server, watch):
    watched = watch(hidden_effect_server.address, 390, 844)
    page = watched.page
    page.locator('.place').first.wait_for()
    numbers = page.locator('.map .js-plotly-plot .heatmap-label')
    page.locator('.map .js-plotly-plot .heatmaplayer image').wait_for()
    assert numbers.count() == 0
    page.set_viewport_size({'width': 844, 'height': 390})
    numbers.first.wait_for(state='attached')
    page.wait_for_function(FITS)
    page.get_by_role('tab', name='Add').click()
    page.locator('tr.on', has_text='v1').wait_for()
    page.set_viewport_size({'width': 390, 'height': 844})
    page.get_by_role('tab', name='Compare').click()
    page.locator('.map .js-plotly-plot .heatmaplayer image').wait_for()
    page.wait_for_function(FITS)
    numbers.first.wait_for(state='detached')
    watched.check()


def test_a_finger_scrolls_over_figures_and_taps_a_cell(hidden_effect_server, watch):
    watched = watch(hidden_effect_server.address, 820, 1180, has_touch=True, is_mobile=True)
    page = watched.page
    cell = page.locator('.cells button[aria-label^="dut2_z, cold dwell, cycle 3"]')
    cell.tap()
    page.locator('.legendtext', has_text='dut2_z, cold dwell, cycle 3').first.wait_for()
    page.wait_for_function(
        "[...document.querySelectorAll('.js-plotly-plot')].every(p => !p._fullLayout.dragmode)"
    )
    page.locator('.modebar-btn[data-title="Zoom in"]').first.wait_for()
    watched.check()
