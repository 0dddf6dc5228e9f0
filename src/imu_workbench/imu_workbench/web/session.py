# SPDX-License-Identifier: Apache-2.0
"""What one browser tab looks at; its address holds all of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal
from urllib.parse import urlencode

from imu_recording.recording import PHASES
from thermal_comp.presentation.display import SENSORS

from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import Place, View
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.workspace import Workspace

Shown = Literal['case', 'fleet', 'live']
PAGE_VIEWS: tuple[Shown, ...] = ('case', 'fleet', 'live')
"""Views of the page; the address names all but the first."""


class Session:
    """One tab's choice of device, version, sensor, axis, place and candidate."""

    def __init__(self, workspace: Workspace, query: Mapping[str, str]) -> None:
        self.workspace = workspace
        self.shown: Shown = 'case'
        self.device = ''
        self.version_name = ''
        self.candidate = ''
        """Effect whose curve is drawn over the residual."""
        self.view = View(SENSORS[0])
        self._sensor_chosen = False
        self.follow(query)

    # The address -------------------------------------------------------------------------------

    def follow(self, query: Mapping[str, str]) -> None:
        """Take over the choices in an address; those it leaves open are made later."""
        self.shown = next((s for s in PAGE_VIEWS if query.get(s) == '1'), 'case')
        self.device = query.get('device', '')
        self.version_name = query.get('version', '')
        self.candidate = query.get('candidate', '')
        sensor, axis = query.get('sensor', ''), query.get('axis', 'x')
        self._sensor_chosen = sensor in SENSORS
        self.view = View(
            sensor if sensor in SENSORS else SENSORS[0],
            max('xyz'.find(axis), 0) if len(axis) == 1 else 0,
            place_of(query),
            window_of_query(query),
        )

    def query(self) -> str:
        """Return the address of what is looked at, '?device=…'."""
        view = self.view
        pairs: dict[str, str] = {}
        if self.device:
            pairs |= {'device': self.device, 'version': self.version_name}
        if self._sensor_chosen:
            pairs |= {'sensor': view.sensor, 'axis': view.axis_name}
        if view.place is not None:
            pairs |= {'run': view.place.run}
            if view.place.phase is not None:
                pairs['phase'] = view.place.phase
            if view.place.cycle is not None:
                pairs['cycle'] = str(view.place.cycle)
            if view.place.low is not None:
                pairs['low'] = f'{view.place.low:g}'
        if view.window is not None:
            pairs['window'] = ','.join(f'{end:.5g}' for end in view.window)
        pairs |= {'candidate': self.candidate}
        pairs |= {self.shown: '1'} if self.shown != 'case' else {}
        return '?' + urlencode({key: value for key, value in pairs.items() if value})

    # What it leads to --------------------------------------------------------------------------

    def settle(self) -> None:
        """Choose what the address leaves open from what there is now."""
        devices = self.workspace.devices
        if self.device not in devices:
            self.device, self.version_name = next(iter(devices), ''), ''
        work = self.work
        if work is None:
            return
        if work.case.version(self.version_name) is None:
            self.version_name = work.case.current
        version = self.version
        if version is None:
            return
        if not self._sensor_chosen or self.view.sensor not in version.comparison['sensors']:
            self.look_at_worst()
        runs = {bag.run for bag in work.bags}
        if self.view.place is not None and self.view.place.run not in runs:
            self.view = replace(self.view, place=None, window=None)

    @property
    def work(self) -> DeviceWork | None:
        """The device looked at."""
        return self.workspace.devices.get(self.device)

    @property
    def version(self) -> Version | None:
        """The version looked at; None while it is not there."""
        return self.work.loaded.get(self.version_name) if self.work else None

    @property
    def earlier_name(self) -> str:
        """The version this one was made from; '' for a first one."""
        known = self.work.case.version(self.version_name) if self.work else None
        return (known.parent or '') if known else ''

    @property
    def earlier_version(self) -> Version | None:
        """That version, as far as it is in memory."""
        return self.work.loaded.get(self.earlier_name) if self.work else None

    @property
    def diagnosis(self) -> dict[str, Any] | None:
        """What was found of the version looked at."""
        return self.work.diagnosis(self.version_name) if self.work else None

    @property
    def errors(self) -> Mapping[str, Mapping[str, float]] | None:
        """Error and floor per sensor [SI unit] of the version looked at; None: not known yet."""
        if self.version is not None:
            return self.version.errors()
        found = self.work.found.get(self.version_name) if self.work else None
        return found['errors'] if found else None

    @property
    def nothing_yet(self) -> str:
        """Text where there is no model: what to do, or why."""
        reading, bags = 'Reading the recordings …', self.work.bags if self.work else []
        if not bags and (self.workspace.opening or self.workspace.reading):
            return reading
        if self.work is None:
            return 'Nothing to look at yet: choose recordings with “Open bags” above.'
        if not bags:
            return 'No recording of this device is open; its versions are kept below.'
        if self.failed and self.version_name:
            return (
                f'{self.version_name} is not compared with the recordings, as the message above '
                'says: mend that and try again, or go on from another version below.'
            )
        comparing = 'The model is being compared with the recordings …'
        return self.work.problem or (reading if self.workspace.reading else comparing)

    @property
    def failed(self) -> bool:
        """Whether the version looked at could not be compared with the recordings."""
        work = self.work
        return work is not None and self.version is None and self.version_name in work.failed

    def sensors(self) -> list[str]:
        """Return the sensors of the version looked at, in the order of the tables."""
        known = self.version.comparison['sensors'] if self.version else {}
        return [sensor for sensor in SENSORS if sensor in known]

    # Choices -----------------------------------------------------------------------------------

    def choose_device(self, name: str) -> None:
        """Look at another device, where it fails most."""
        self.device, self.version_name, self.candidate = name, '', ''
        self.view, self._sensor_chosen = View(SENSORS[0]), False

    def choose_channel(self, sensor: str, axis: int) -> None:
        """Look at another sensor or axis; place and window stay."""
        if sensor != self.view.sensor:
            self.candidate = ''
        self.view = replace(self.view, sensor=sensor, axis=axis)
        self._sensor_chosen = True

    def choose_version(self, name: str) -> None:
        """Look at another version."""
        self.version_name, self.candidate = name, ''

    def go_to(self, place: Place | None) -> None:
        """Look at a place; the same again, or None, looks at everything."""
        place = None if place == self.view.place else place
        self.view = replace(self.view, place=place, window=None)

    def brush(self, window: tuple[float, float] | None) -> None:
        """Look at a part of the time; None looks at all of it."""
        self.view = replace(self.view, place=None, window=window)

    def look_at_worst(self) -> None:
        """Look at the sensor and axis that are furthest above their noise floor."""
        if self.version is None:
            return
        ratios = {
            (sensor, axis): (error or 0.0) / floor
            for sensor, part in self.version.comparison['sensors'].items()
            for axis, (error, floor) in enumerate(
                zip(part['held_out_rms'], part['noise_floor'], strict=True)
            )
            if floor
        }
        if ratios:
            sensor, axis = max(ratios, key=lambda key: ratios[key])
            self.view = replace(self.view, sensor=sensor, axis=axis)
            self._sensor_chosen = True


def place_of(query: Mapping[str, str]) -> Place | None:
    """Return the place an address names; None where it names none."""
    if not query.get('run'):
        return None
    phase, cycle, low = (query.get(key, '') for key in ('phase', 'cycle', 'low'))
    number = low.removeprefix('-').replace('.', '', 1)
    return Place(
        query['run'],
        phase if phase in PHASES else None,
        int(cycle) if cycle.isdigit() else None,
        float(low) if number.isdigit() else None,
    )


def window_of_query(query: Mapping[str, str]) -> tuple[float, float] | None:
    """Return the part of the time axis an address names [h]; None where it names none.

    >>> window_of_query({'window': '1.5,3'}), window_of_query({'window': '3'})
    ((1.5, 3.0), None)
    """
    first, _, last = query.get('window', '').partition(',')
    try:
        low, high = float(first), float(last)
    except ValueError:
        return None
    return (low, high) if low < high else None
