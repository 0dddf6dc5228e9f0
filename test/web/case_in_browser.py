# SPDX-License-Identifier: Apache-2.0
"""A case outlives reload, tab and server; its versions branch, its recordings come and go."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import pytest
import yaml

from .bad_input_in_browser import EFFECT
from .conftest import wait_for_verdict


def add(page, effect: str) -> None:
    """Add an effect from the rail, wherever it stands there."""
    button = page.get_by_role('button', name=f'Add {effect}', exact=True).or_(
        page.get_by_role('button', name=f'Add anyway {effect}', exact=True)
    )
    further = page.locator('.further')
    if further.count() and further.get_attribute('open') is None:
        further.locator('summary').click()
    button.last.click()


@pytest.fixture
def held_by(tmp_path: Path) -> Path:
    """File that holds back the fits, or the figures, of a server it is given to."""
    held_by = tmp_path / 'held_by'
    os.mkfifo(held_by)
    return held_by


def release(held_by: Path) -> None:
    """Let what is held back begin, now and later."""
    writing = os.open(held_by, os.O_RDWR)  # waits for no reader
    held_by.unlink()
    held_by.touch()
    os.close(writing)


def test_reload_back_and_a_killed_server_lose_nothing(serve, watch, small_bags, tmp_path):
    cases = tmp_path / 'cases'
    bag = small_bags / 'dut2_x'
    server = serve(bag, cases=cases, answered=[bag])
    watched = watch(server.address)
    page = watched.page
    wait_for_verdict(page)
    page.get_by_label('Notes').fill('the blue board')
    page.locator('.axis', has_text='y').click()
    page.locator('.axis.on', has_text='y').wait_for()
    page.locator('.ytitle', has_text='error y').wait_for()  # the list of places is that of y
    page.locator('.place').first.click()
    page.locator('.place.on').wait_for()
    place = page.locator('.place.on').inner_text()
    add(page, 'temperature rate')
    page.locator('.tree-row.on', has_text='v2').wait_for()
    page.wait_for_url('**version=v2**')
    address = page.url

    page.reload()
    page.locator('.place.on').wait_for()
    assert page.url == address
    assert page.locator('.axis.on').inner_text().startswith('y')

    server.kill()
    page.goto('about:blank')  # it would load itself again once the server is back
    server = serve(cases / 'dut2', port=server.port)
    page.goto(address)
    page.locator('.place.on').wait_for()
    watched.complaints.clear()  # the browser said that the server was away
    assert page.locator('.place.on').inner_text().split(',')[0] == place.split(',')[0]
    page.locator('.tree-row.on', has_text='v2').wait_for()
    assert page.locator('.tree-row').count() == 3  # the head, v1 and v2
    assert page.get_by_label('Notes').input_value() == 'the blue board'
    wait_for_verdict(page)
    page.locator('.version', has_text='v1').click()
    page.locator('.tree-row.on', has_text='v1').wait_for()
    page.wait_for_url('**version=v1**')
    page.go_back()
    page.locator('.tree-row.on', has_text='v2').wait_for()

    check_saved_case(page)
    assert server.alive
    watched.check()


def check_saved_case(page) -> None:
    """The zip holds the case with the model of every version."""
    with page.expect_download() as saving:
        page.get_by_role('button', name='Save the case').click()
    with zipfile.ZipFile(saving.value.path()) as case:
        content = yaml.safe_load(case.read('dut2/case.yaml'))
        assert {f'dut2/versions/{v["name"]}.yaml' for v in content['versions']} <= set(
            case.namelist()
        )
    assert [v['parent'] for v in content['versions']] == [None, 'v1']


@pytest.mark.long
def test_fits_queue_branch_and_are_cancelled_and_bags_come_and_go(
    serve, watch, small_bags, held_by
):
    bag = small_bags / 'dut2_x'
    server = serve(bag, '--root', small_bags, held_by=held_by, answered=[bag])
    watched = watch(server.address)
    page = watched.page
    wait_for_verdict(page)
    for effect in ('temperature rate', 'humidity', 'icing'):
        add(page, effect)
    page.locator('.fit', has_text='icing').get_by_role('button').click()
    page.locator('.fit', has_text='icing').wait_for(state='detached')
    release(held_by)
    page.locator('.tree-row', has_text='v2 + temperature rate').wait_for()
    page.locator('.tree-row', has_text='v3 + humidity').wait_for()
    page.locator('.tree-row.on', has_text='v3').wait_for()
    assert page.locator('.tree-row', has_text='icing').count() == 0

    page.locator('.version', has_text='v1').click()  # back, and on from there: a branch
    page.locator('.tree-row.on', has_text='v1').wait_for()
    add(page, 'supply sensitivity')
    page.locator('.tree-row.on', has_text='v4').wait_for()
    rows = page.locator('.tree .version')
    assert rows.count() == 4
    content = yaml.safe_load((server.cases / 'dut2' / 'case.yaml').read_text('utf-8'))
    assert [v['parent'] for v in content['versions']] == [None, 'v1', 'v2', 'v1']
    assert content['requested'] == []

    page.get_by_role('button', name='Open bags').click()
    page.get_by_role('checkbox', name='dut2_again').click()
    page.locator('.dialog').get_by_role('button', name='Open', exact=True).click()
    page.locator('.summary', has_text='2 runs').wait_for()
    page.locator('.tile.bad, .tile.good').first.wait_for()
    assert rows.count() == 4
    page.locator('.summary', has_text='2 runs').click()
    page.get_by_role('button', name='close dut2_x').click()
    page.locator('.summary', has_text='1 run').wait_for()
    assert rows.count() == 4
    content = yaml.safe_load((server.cases / 'dut2' / 'case.yaml').read_text('utf-8'))
    assert {r['run']: r['open'] for r in content['recordings']} == {
        'dut2_again': True, 'dut2_x': False,
    }  # fmt: skip
    assert server.alive
    watched.check()


@pytest.mark.long
def test_verdict_and_fits_are_shown_while_figures_are_computed(serve, watch, small_bags, held_by):
    bag = small_bags / 'dut2_x'
    server = serve(bag, held_by=held_by, holds='figures', answered=[bag])
    watched = watch(server.address)
    page = watched.page
    page.set_default_timeout(60_000)
    try:
        wait_for_verdict(page)
        add(page, 'temperature rate')
        page.locator('.tree-row.on', has_text='v2').wait_for()
        assert not page.locator('.place:not(.all)').count()
    finally:
        release(held_by)
    page.locator('.place:not(.all)').first.wait_for()
    watched.check()


HOLD_PRESSES = """() => {
    const emit = socket.emit.bind(socket), held = [];
    let holds = true;
    socket.emit = (kind, ...rest) =>
        holds && kind === 'event' ? held.push(rest) : emit(kind, ...rest);
    window.passOn = () => { holds = false; };
    window.sendHeld = () => held.forEach((rest) => emit('event', ...rest));
}"""
"""Keep back what the page tells its server until `passOn`; `sendHeld` sends it late."""


@pytest.mark.long
def test_a_press_that_arrives_after_the_page_was_drawn_anew_is_heard(serve, watch, small_bags):
    bag = small_bags / 'dut2_x'
    watched = watch(serve(bag, answered=[bag]).address)
    page = watched.page
    wait_for_verdict(page)
    page.evaluate(HOLD_PRESSES)
    with page.expect_file_chooser():  # a browser opens none for a press that is answered late
        page.get_by_role('button', name='Open a model').click()
    add(page, 'temperature rate')
    page.evaluate('passOn()')
    page.get_by_role('button', name='Preview humidity').click()
    page.get_by_role('button', name='Hide humidity').wait_for()
    page.evaluate('sendHeld()')
    page.locator('.version', has_text='v2 + temperature rate').wait_for()
    watched.check()


COUNT_RESTYLING = """() => {
    window.restyled = 0;
    new MutationObserver((changes) => { window.restyled += changes.length; })
        .observe(document.body, { attributeFilter: ['class'] });
}"""
"""Count how often the body's class is set: the styles of thousands of elements follow."""


@pytest.mark.long
def test_a_part_that_is_drawn_anew_by_a_key_keeps_the_focus(serve, watch, small_bags):
    bag = small_bags / 'dut2_x'
    watched = watch(serve(bag, answered=[bag]).address)
    page = watched.page
    wait_for_verdict(page)
    page.wait_for_function("!document.querySelector('[inert]')")
    page.set_default_timeout(60_000)
    page.evaluate(COUNT_RESTYLING)
    focused = page.locator(':focus')
    preview = page.locator('.rail').get_by_role('button', name='Preview temperature rate')
    preview.focus()
    page.keyboard.down('Enter')  # drawn anew before the key rises, a button would forget it
    page.get_by_role('button', name='Hide temperature rate').and_(focused).wait_for()
    page.keyboard.up('Enter')
    page.keyboard.press('Enter')
    preview.and_(focused).wait_for()
    place = page.locator('.place').nth(1)
    place.focus()
    page.keyboard.press('Enter')
    page.locator('.place.on').and_(focused).wait_for()
    place.click()  # a pointer: the focus is where it was pressed, nowhere else
    page.get_by_role('heading', name='IMU workbench').click()
    preview.click()
    page.get_by_role('button', name='Hide temperature rate').wait_for()
    assert not page.get_by_role('button', name='Hide temperature rate').and_(focused).count()
    assert page.evaluate('restyled') == 0
    watched.check()


@pytest.mark.long
def test_a_version_whose_file_is_missing_is_said_and_tried_again(
    serve, watch, small_bags, tmp_path
):
    bag, cases = small_bags / 'dut2_x', tmp_path / 'cases'
    server = serve(bag, cases=cases, answered=[bag])
    model = cases / 'dut2' / 'versions' / 'v1.yaml'
    server.kill()
    model.rename(tmp_path / 'v1.yaml')
    server = serve(cases / 'dut2')
    watched = watch(server.address)
    page = watched.page
    page.locator('.message', has_text='v1.yaml: No such file or directory; put it back').wait_for()
    told = 'v1 is not compared with the recordings, as the message above says'
    page.locator('.verdict', has_text=told).wait_for()
    page.locator('.rail[aria-busy=false]', has_text='once v1 is compared').wait_for()
    (tmp_path / 'v1.yaml').rename(model)
    page.get_by_role('button', name='Try v1 again').click()
    page.locator('.tile.bad').first.wait_for()
    wait_for_verdict(page)
    assert not page.get_by_role('button', name='Try v1 again').count()
    watched.check()


@pytest.mark.long
def test_a_fit_that_waits_when_the_server_is_killed_is_done_by_the_next(
    serve, watch, small_bags, tmp_path, held_by
):
    cases = tmp_path / 'cases'
    bag = small_bags / 'dut2_x'
    server = serve(bag, cases=cases, held_by=held_by, answered=[bag])
    watched = watch(server.address)
    page = watched.page
    wait_for_verdict(page)
    for effect in ('temperature rate', 'humidity'):
        add(page, effect)
    page.locator('.fit', has_text='humidity').wait_for()
    server.kill()
    content = yaml.safe_load((cases / 'dut2' / 'case.yaml').read_text('utf-8'))
    assert 'humidity' in [fit['effect'] for fit in content['requested']]
    address = page.url
    assert 'version=v1' in address
    page.goto('about:blank')
    server = serve(cases / 'dut2', port=server.port)
    page.goto(address)
    page.locator('.tree-row.on', has_text='v3 + humidity').wait_for()  # the tab goes on to it
    page.locator('.tree-row', has_text='v2 + temperature rate').wait_for()
    page.locator('.version', has_text='v1').click()
    page.locator('.tree-row.on', has_text='v1').wait_for()
    page.wait_for_url('**version=v1**')
    page.reload()  # whoever went back stays there
    wait_for_verdict(page)
    assert 'v1' in page.locator('.tree-row.on').inner_text()
    assert server.alive


@pytest.mark.long
def test_an_effect_file_is_kept_in_the_case_and_asked_for_where_it_was_never_given(
    serve, watch, small_bags, tmp_path
):
    cases, effect = tmp_path / 'cases', tmp_path / 'my_effect.py'
    effect.write_text(EFFECT, 'utf-8')
    server = serve(small_bags / 'dut2_x', '--effects', effect, cases=cases)
    page = watch(server.address).page
    wait_for_verdict(page)
    add(page, 'kink')
    page.locator('.tree-row.on', has_text='+ kink').wait_for()
    server.kill()
    effect.unlink()

    server = serve(cases / 'dut2')  # where the file was given before
    again = watch(server.address)
    again.page.locator('.term', has_text='kink').wait_for()
    assert again.page.locator('.message').count() == 0
    server.kill()

    (cases / '.allowed_effects.json').unlink()  # as where the case was copied to
    server = serve(cases / 'dut2')
    elsewhere = watch(server.address)
    told = 'v2 needs my_effect.py, which is kept in the case'
    elsewhere.page.locator('.message', has_text=told).wait_for()
    elsewhere.page.get_by_role('button', name='Load my_effect.py, kept in this case').click()
    elsewhere.page.locator('.term', has_text='kink').wait_for()
    assert server.alive
    elsewhere.check()


@pytest.mark.long
def test_two_tabs_and_two_devices_keep_out_of_each_others_way(serve, watch, small_bags):
    bags = [small_bags / 'dut2_x', small_bags / 'dut7_x']
    server = serve(*bags, answered=bags)
    one = watch(server.address)
    one.page.locator('.tile.bad').first.wait_for()
    other = watch(server.address, color_scheme='dark')
    wait_for_verdict(one.page)
    other.page.get_by_role('combobox', name='Device').click()
    other.page.get_by_role('option', name='dut7').click()
    other.page.wait_for_url('**device=dut7**')
    wait_for_verdict(other.page)
    assert 'device=dut2' in one.page.url
    one.page.locator('.axis', has_text='z').click()
    one.page.locator('.axis.on', has_text='z').wait_for()
    add(other.page, 'temperature rate')
    other.page.locator('.tree-row.on', has_text='v2').wait_for()
    assert one.page.locator('.tree-row').count() == 2
    assert sorted(p.name for p in server.cases.iterdir() if p.is_dir()) == ['dut2', 'dut7']

    one.page.get_by_role('button', name='Fleet', exact=True).click()
    one.page.wait_for_url('**fleet=1**')
    rows = one.page.locator('.fleet-table tbody tr')
    rows.nth(1).wait_for()
    assert 'dut2' in rows.nth(0).inner_text()  # dut7 has its effect by now
    assert 'emperature rate' in rows.nth(0).inner_text()
    rows.nth(1).get_by_role('button', name='dut7').click()
    one.page.locator('.tree-row.on', has_text='v2').wait_for()
    one.page.wait_for_url(lambda url: 'fleet' not in url)

    third = watch(other.page.url)  # a second tab of the same device sees what the first did
    third.page.locator('.tree-row.on', has_text='v2').wait_for()
    assert server.alive
    for watched in (one, other, third):
        watched.check()


def test_a_path_that_is_not_there_is_refused_before_the_server_starts(serve, tmp_path):
    with pytest.raises(AssertionError):
        serve(tmp_path / 'nowhere', by_command=True)


@pytest.mark.long
def test_a_case_that_is_served_twice_is_refused(serve, small_bags, tmp_path, capfd):
    cases = tmp_path / 'cases'
    bag = small_bags / 'dut2_x'
    server = serve(bag, cases=cases, answered=[bag])
    with pytest.raises(AssertionError):
        serve(bag, cases=cases, by_command=True)
    assert 'another server has these cases open' in capfd.readouterr().err
    assert server.alive
    assert Path(cases).exists()
