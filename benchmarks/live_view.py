# SPDX-License-Identifier: Apache-2.0
"""How often the live tab is drawn: python benchmarks/live_view.py [--rate 59.5] [--seconds 20].

Publishes a resting board, its compensation and both filters, opens the page in headless Chromium
and counts what the browser has drawn. Exit code 1 below five pictures a second; the browser draws
without a graphics card, so that a machine should be quiet.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import rclpy
from playwright.sync_api import Page, sync_playwright
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import Imu, MagneticField, Temperature
from verdict import Verdict, judge

ROOT = Path(__file__).resolve().parents[1]
LEAST_HZ = 5.0
DOMAIN = 88
SETTLING_MS = 25_000
"""The window is left to fill before pictures are counted."""
NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
COUNT = """() => {
  window.lines = [];
  window.values = [];
  document.querySelector('.live .js-plotly-plot')
    .on('plotly_afterplot', () => lines.push(performance.now()));
  new MutationObserver(() => values.push(performance.now()))
    .observe(document.querySelector('.live-boards'), {childList: true, subtree: true});
}"""
PER_SECOND = '([lines, values].map(t => 1e3 * (t.length - 1) / (t[t.length - 1] - t[0])))'


class Board(Node):
    """A board that rests, its compensation and both filters."""

    def __init__(self, context: Context) -> None:
        super().__init__('board', namespace='/dut1', context=context, use_global_arguments=False)
        self._raw, self._compensated = (
            self.create_publisher(Imu, f'{name}/data_raw', 50)
            for name in ('imu', 'imu_compensated')
        )
        self._filtered = [
            self.create_publisher(Imu, f'imu/data_{name}', 50)
            for name in ('complementary', 'ahrs')
        ]
        self._fields = [
            self.create_publisher(MagneticField, f'{name}/mag', 50)
            for name in ('imu', 'imu_compensated')
        ]
        self._die = self.create_publisher(Temperature, 'imu/temperature', 50)

    def send(self, number: int) -> None:
        """Publish one sample of everything."""
        stamp = self.get_clock().now().to_msg()
        wave = 0.01 * math.sin(number / 40.0)
        imu = Imu()
        imu.header.stamp = stamp
        imu.orientation_covariance[0] = -1.0
        imu.angular_velocity.x, imu.linear_acceleration.z = wave, 9.81 + wave
        self._raw.publish(imu)
        imu.angular_velocity.x = 0.1 * wave
        self._compensated.publish(imu)
        imu.orientation_covariance[0] = 1e-4
        imu.orientation.x, imu.orientation.w = math.sin(wave), math.cos(wave)
        for publisher in self._filtered:
            publisher.publish(imu)
        field = MagneticField()
        field.header.stamp = stamp
        field.magnetic_field.x = 2e-5 + 1e-6 * wave
        for publisher in self._fields:
            publisher.publish(field)
        die = Temperature(temperature=25.0 + wave)
        die.header.stamp = stamp
        self._die.publish(die)


@contextmanager
def publishing(rate: float) -> Iterator[None]:
    """Publish in a thread."""
    context, ended = Context(), Event()
    rclpy.init(args=[], context=context, domain_id=DOMAIN)
    board = Board(context)

    def publish() -> None:
        number = 0
        while not ended.wait(1.0 / rate):
            board.send(number)
            number += 1

    thread = Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        board.destroy_node()
        rclpy.try_shutdown(context=context)


@contextmanager
def serving() -> Iterator[str]:
    """Serve on a free port; yield the address."""
    command = [sys.executable, '-m', 'imu_workbench', 'serve', '--port', '0', '--root']
    server = subprocess.Popen(
        [*command, str(ROOT / 'bags')], stdout=subprocess.PIPE, text=True, cwd=ROOT,
        env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN)},
    )  # fmt: skip
    try:
        yield server.stdout.readline().split()[2]
    finally:
        server.terminate()
        server.wait()


def pictures_per_second(page: Page, seconds: float) -> tuple[float, float]:
    """Return how often the lines of the first figure and the attitude were drawn."""
    page.locator('.live .js-plotly-plot .main-svg').nth(3).wait_for()
    page.get_by_role('combobox', name='last').click()
    page.get_by_role('option', name='20 s').click()
    page.wait_for_timeout(SETTLING_MS)
    page.evaluate(COUNT)
    page.wait_for_timeout(1000.0 * seconds)
    lines, values = page.evaluate(PER_SECOND)
    return lines, values


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--rate', type=float, default=59.5, help='of the board [Hz]')
    parser.add_argument('--seconds', type=float, default=20.0, help='that are counted')
    options = parser.parse_args()
    named = os.environ.get('CHROMIUM') or next(filter(None, map(shutil.which, NAMES)), None)
    with publishing(options.rate), serving() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=named, args=['--no-sandbox', '--disable-gpu']
        )
        page = browser.new_context(viewport={'width': 1280, 'height': 800}).new_page()
        page.goto(f'{address}?live=1')
        lines, values = pictures_per_second(page, options.seconds)
        browser.close()
    verdicts = [
        Verdict(f'live {what}', rate, LEAST_HZ, 'pictures/s', at_least=True)
        for what, rate in (('lines of 20 s', lines), ('attitude', values))
    ]
    return 1 if judge(verdicts) else 0


if __name__ == '__main__':
    sys.exit(main())
