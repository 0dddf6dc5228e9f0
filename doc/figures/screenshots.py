# SPDX-License-Identifier: Apache-2.0
"""Photograph the workbench and the report in headless Chromium, over the bags that ship.

Usage: python doc/figures/screenshots.py [case live report]   (default: all)
Needs playwright and a Chromium: CHROMIUM=/path/to/chrome, else one on PATH, else playwright's own.
"""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path
from signal import SIGINT
from tempfile import TemporaryDirectory

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BAGS = [ROOT / 'bags' / f'hidden_effect_{axis}' for axis in 'xyz']
STILL = [ROOT / 'bags' / f'dut1_{axis}' for axis in 'xyz']
SIZE = {'width': 1280, 'height': 800}
LARGEST = 150_000
"""A picture in a repository stays below this [bytes]."""
PATIENCE_MS = 300_000
NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
WORKBENCH = [sys.executable, '-m', 'imu_workbench']
DOMAIN = '87'
"""ROS domain of the live picture, away from the user's."""
SPEED = 10.0
"""How much faster than in a laboratory the chamber of the live picture is."""
SECTION = 'diagnosis'
"""Part of the report that is shown."""
WATCHED_MS = 70_000
"""How long the live view is left to fill."""


def save(page: Page, name: str) -> None:
    """Write doc/figures/NAME.png in as many colours as the size allows."""
    page.mouse.move(0, 0)
    page.locator('.job').first.wait_for(state='detached')  # it would stand before the picture
    page.wait_for_timeout(1000)
    picture = Image.open(BytesIO(page.screenshot())).convert('RGB')
    for colours in (256, 128, 64, 32):
        packed = BytesIO()
        picture.quantize(colours, dither=Image.Dither.NONE).save(packed, 'PNG', optimize=True)
        if packed.tell() <= LARGEST:
            break
    (HERE / f'{name}.png').write_bytes(packed.getvalue())
    sys.stdout.write(f'{name}.png: {packed.tell() // 1000} kB\n')


@contextmanager
def serving(*bags: Path, environment: dict[str, str] | None = None) -> Iterator[str]:
    """Serve bags on a free port; yield the address."""
    with TemporaryDirectory() as cases:
        command = [*WORKBENCH, 'serve', '--port', '0', '--case', cases, *map(str, bags)]
        server = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment
        )
        try:
            yield server.stdout.readline().split()[2]
        finally:
            server.terminate()
            server.wait()


def open_page(browser: Browser, address: str) -> Page:
    """Open an address in a light window of the pictures' size."""
    page = browser.new_context(viewport=SIZE, color_scheme='light').new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(address)
    return page


def photograph_workbench(browser: Browser) -> None:
    """Read the verdict, preview what is missing, add it."""
    with serving(*BAGS) as address:
        page = open_page(browser, address)
        page.locator('.verdict.missing').wait_for()
        page.get_by_role('button', name='Preview thermal lag').first.click()
        page.locator('.legendtext', has_text='thermal lag would explain').first.wait_for()
        save(page, 'workbench_case')
        page.locator('.top').get_by_role('button', name='Add thermal lag').click()
        page.locator('.tile.good', has_text='Accelerometer').wait_for()
        page.locator('.verdict.complete').wait_for()
        page.locator('.bottom').scroll_into_view_if_needed()
        page.locator('[data-plot="error_staircase"] .main-svg').first.wait_for()
        save(page, 'workbench_versions')


def surroundings(folder: Path) -> Path:
    """Write the temperature around the simulated board: the chamber's profile, sped up."""
    subprocess.run(
        [*WORKBENCH, 'plan', 'short_20min', '--csv', folder / 'plan.csv'],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    with (folder / 'plan.csv').open(newline='') as file:
        rows = [(row['time_s'], row['temperature_c']) for row in csv.DictReader(file)]
    with (folder / 'air.csv').open('w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(('time_s', 'temperature_c'))
        writer.writerows((float(time) / SPEED, air) for time, air in rows)
    return folder / 'air.csv'


@contextmanager
def running_system(folder: Path, environment: dict[str, str]) -> Iterator[None]:
    """Run driver, compensation, filters and chamber on simulated devices."""
    model = folder / 'model.yaml'
    fit = [*WORKBENCH, 'fit', *STILL, '-o', model, '--force']
    subprocess.run(fit, check=True, stdout=subprocess.DEVNULL)
    air = surroundings(folder)
    source = ('-r', 'imu/data_raw:=imu_compensated/data_raw', '-r', 'imu/mag:=imu_compensated/mag')
    nodes = [
        ('imu_driver', 'imu_driver_node', '-p', f'transport:=simulated://dut1?temperature={air}',
         '-p', 'output_data_rate:=59.5'),
        ('thermal_comp', 'thermal_comp_node', '-p', f'model:={model}'),
        ('orientation_filters', 'complementary_filter_node', *source,
         '-r', 'imu/data:=imu/data_complementary'),
        ('orientation_filters', 'ahrs_filter_node', *source, '-r', 'imu/data:=imu/data_ahrs'),
        ('chamber_profile', 'chamber_profile_node', '-p', 'profile:=short_20min',
         '-p', 'start:=true', '-p', 'require_imu:=false', '-p', f'time_scale:={SPEED}',
         '-p', f'run_directory:={folder}/run'),
    ]  # fmt: skip
    with (folder / 'nodes.txt').open('w') as log, ExitStack() as started:
        for package, executable, *arguments in nodes:
            path = ROOT / 'install' / package / 'lib' / package / executable
            command = [str(path), '--ros-args', '-r', '__ns:=/dut1', *arguments]
            node = subprocess.Popen(
                command, env=environment, stdout=log, stderr=subprocess.STDOUT, cwd=folder
            )
            started.callback(node.wait)
            started.callback(node.kill if package == 'chamber_profile' else node.send_signal,
                             *([] if package == 'chamber_profile' else [SIGINT]))  # fmt: skip
        yield


def photograph_live(browser: Browser) -> None:
    """Watch a running system for a while."""
    with TemporaryDirectory() as name:
        environment = {**os.environ, 'ROS_DOMAIN_ID': DOMAIN, 'ROS_LOG_DIR': name}
        with serving(*BAGS, environment=environment) as address:
            page = open_page(browser, address)
            page.locator('.place').first.wait_for()
            page.get_by_role('button', name='Live', exact=True).click()
            page.get_by_text('No IMU is heard').wait_for()
            with running_system(Path(name), environment):
                page.locator('.live-tiles dd').first.wait_for()
                page.get_by_role('combobox', name='sensor').click()
                page.get_by_role('option', name='accelerometer').click()
                page.wait_for_timeout(WATCHED_MS)
                save(page, 'workbench_live')


def photograph_report(browser: Browser) -> None:
    """Show what a report says is missing."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'report.html'
        command = [*WORKBENCH, 'report', *BAGS, '--no-attitude', '-o', path, '--force']
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        page = open_page(browser, f'{path.as_uri()}#{SECTION}')
        figure = page.locator(f'#{SECTION} .js-plotly-plot .main-svg').first
        for _ in range(3):  # figures above are drawn on the way and may move it
            figure.wait_for()
            page.locator(f'#{SECTION}').evaluate('part => part.scrollIntoView()')
            page.wait_for_timeout(2000)
        save(page, 'report')


def main(wanted: set[str]) -> None:
    """Take the pictures."""
    named = os.environ.get('CHROMIUM') or next(filter(None, map(shutil.which, NAMES)), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=named, args=['--no-sandbox', '--disable-gpu']
        )
        if 'case' in wanted:
            photograph_workbench(browser)
        if 'live' in wanted:
            photograph_live(browser)
        if 'report' in wanted:
            photograph_report(browser)
        browser.close()


if __name__ == '__main__':
    main(set(sys.argv[1:]) or {'case', 'live', 'report'})
