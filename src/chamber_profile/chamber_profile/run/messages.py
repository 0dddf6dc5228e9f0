# SPDX-License-Identifier: Apache-2.0
"""A moment of a run as ROS messages and as diagnostics, with the time that is left."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from imu_recording.logging_contract import PHASE_TOPIC
from imu_recording.recorder.run_announcement import RUN_TOPIC, RunAnnouncement
from imu_recording.ros.messages import (
    TemperatureSample,
    float_message,
    humidity_message,
    temperature_from_sample,
)
from sensor_msgs.msg import RelativeHumidity, Temperature
from std_msgs.msg import Float64

from chamber_profile.profile.values import Step
from chamber_profile.run.conductor import Moment
from chamber_profile.run.values import (
    ABORTED,
    CONFIRM,
    DWELL,
    FINISHED,
    HOLD_FAULT,
    IN_CHARGE,
    MOVE,
    PAUSED,
    RUN,
    SAFE,
    STOP,
    Progress,
)

if TYPE_CHECKING:
    from chamber_profile.run.config import Run

FRAME = 'chamber'
OUTPUTS: dict[str, type] = {
    'chamber/setpoint': Temperature,
    'chamber/temperature': Temperature,
    'chamber/temperature_2': Temperature,
    'chamber/device_temperature': Temperature,
    'chamber/humidity': RelativeHumidity,
    'chamber/heater': Float64,
    'chamber/compressor': Float64,
    'chamber/fan': Float64,
}
"""Topics a chamber can fill; those it says nothing about stay silent."""


def chamber_messages(moment: Moment) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of everything the chamber says at this moment."""
    reading = moment.reading
    if reading is None:
        return
    temperatures = {
        'chamber/setpoint': reading.setpoint,
        'chamber/temperature': reading.air,
        'chamber/temperature_2': reading.air_2,
        'chamber/device_temperature': reading.device,
    }
    for topic, value in temperatures.items():
        if value is not None:
            sample = TemperatureSample(moment.stamp, value, frame_id=FRAME)
            yield topic, temperature_from_sample(sample)
    if reading.humidity is not None:
        yield 'chamber/humidity', humidity_message(moment.stamp, reading.humidity, FRAME)
    states = {'heater': reading.heater, 'compressor': reading.compressor, 'fan': reading.fan}
    for name, state in states.items():
        if state is not None:
            yield f'chamber/{name}', float_message(state)


def outputs(*, temperatures: bool) -> dict[str, type]:
    """Return type by topic of what to publish, with or without the chamber's temperatures."""
    return {
        topic: kind
        for topic, kind in OUTPUTS.items()
        if temperatures or 'temperature' not in topic
    }


def latched_texts(run: Run) -> dict[str, str]:
    """Return what chamber/run and chamber/phase say now; no phase before and after the run."""
    sequencer = run.conductor.sequencer
    step, mode = sequencer.step, sequencer.progress.mode
    texts = {RUN_TOPIC: _announcement(run, step, under_way=mode in (*IN_CHARGE, SAFE)).text()}
    if mode in IN_CHARGE:
        texts[PHASE_TOPIC] = f'{step.phase} {step.cycle}'
    return texts


def _announcement(run: Run, step: Step, *, under_way: bool) -> RunAnnouncement:
    profile = run.conductor.sequencer.profile
    runs = max(1, len(profile.orientations))
    up_axis = step.orientation if under_way or runs == 1 else ''
    return RunAnnouncement(
        directory=run.directory.absolute().name,
        run=up_axis.lstrip('+'),
        runs=runs,
        up_axis=up_axis,
        profile=profile.name,
        profile_sha256=profile.sha256,
        topics=profile.record.topics,
        split=profile.record.split,
    )


def what_to_expect(run: Run, node: str) -> str:
    """Return what is ready to run, and how it is started."""
    sequencer = run.conductor.sequencer
    done = f', from step {sequencer.progress.step + 1} on' if run.resumed else ''
    return (
        f'{sequencer.profile.name} is ready, {len(sequencer.steps)} steps{done}; nothing moves '
        f'until: ros2 service call {node}/start std_srvs/srv/Trigger'
    )


def run_status(moment: Moment, run: Run) -> tuple[int, str, dict[str, Any]]:
    """Return level, line and values of a run for diagnostics."""
    progress, link = moment.progress, run.conductor.link
    waiting = progress.mode in (PAUSED, HOLD_FAULT) or progress.stage == CONFIRM
    level = 2 if progress.mode in (SAFE, ABORTED) else int(waiting or bool(moment.complaint))
    line = progress.mode if progress.mode != RUN else f'{progress.mode} {moment.step.id}'
    told = moment.prompt or progress.reason or moment.complaint
    reading = moment.reading
    phase_left, run_left = time_left(run.conductor.sequencer.steps, progress, moment.dwelt_s)
    values = {
        'mode': progress.mode,
        'step': moment.step.id,
        'step_number': f'{progress.step + 1}/{len(run.conductor.sequencer.steps)}',
        'stage': progress.stage,
        'cycle': moment.step.cycle,
        'orientation': moment.step.orientation or 'not stated',
        'programmed [°C]': progress.setpoint if progress.setpoint is not None else 'none',
        'air [°C]': reading.air if reading else 'unknown',
        'dwell [s]': f'{moment.dwelt_s:.0f} of {moment.step.dwell_s:.0f}',
        'phase_left [s]': f'{phase_left:.0f}',
        'run_left [s]': f'{run_left:.0f}',
        'prompt': moment.prompt or 'none',
        'reason': progress.reason or 'none',
        'interruptions': progress.interruptions,
        'chamber': link.identity or 'not reached yet',
        'limits_programmed': link.chamber.programs_limits,
        'link': link.status,
        'link_failures': link.failures,
        'complaint': moment.complaint or 'none',
        'run_directory': str(run.directory),
        'resumed': run.resumed,
    }
    return level, f'{line}: {told}' if told else line, values


def time_left(steps: Sequence[Step], progress: Progress, dwelt_s: float) -> tuple[float, float]:
    """Return what is left of the phase and of the run [s of the chamber].

    Before the chamber was ever moved, the run begins at the first step's target.
    """
    if progress.mode in FINISHED or progress.stage == STOP:
        return 0.0, 0.0
    here = steps[progress.step]
    parts = [_rest_of(here, progress, dwelt_s)]
    for before, step in zip(steps[progress.step :], steps[progress.step + 1 :], strict=False):
        parts.append(_move_s(step, before.target_c) + _stay_s(step))
    names = [(step.phase, step.cycle) for step in steps[progress.step :]]
    same = len(list(takewhile(lambda name: name == names[0], names)))
    return sum(parts[:same]), sum(parts)


def _rest_of(step: Step, progress: Progress, dwelt_s: float) -> float:
    at = step.target_c if progress.setpoint is None else progress.setpoint
    move = _move_s(step, at) if progress.stage == MOVE else 0.0
    spent = dwelt_s if progress.stage == DWELL else 0.0
    return move + max(_stay_s(step) - spent, 0.0)


def _move_s(step: Step, from_c: float) -> float:
    return abs(step.target_c - from_c) / step.rate_c_per_min * 60.0


def _stay_s(step: Step) -> float:
    return step.expected_s if step.kind == 'operator' else step.dwell_s
