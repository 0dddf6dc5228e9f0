# SPDX-License-Identifier: Apache-2.0
"""State of a run as ROS messages and as diagnostics, with the time that is left."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise, takewhile
from typing import Any

from imu_recording.logging_contract import PHASE_TOPIC, TRACKS, VALUE_OF_MESSAGE
from imu_recording.recorder.run_announcement import RUN_TOPIC, RunAnnouncement
from imu_recording.ros.message_cdr import message_class
from imu_recording.ros.messages import (
    TemperatureSample,
    float_message,
    humidity_message,
    temperature_from_sample,
)

from chamber_profile.profile.values import Step
from chamber_profile.run.conductor import RunSnapshot
from chamber_profile.run.config import Run
from chamber_profile.run.values import (
    ABORTED,
    CONFIRM,
    CONTROLLING,
    DWELL,
    FINISHED,
    HOLD_FAULT,
    MOVE,
    PAUSED,
    RUN,
    SAFE,
    STOP,
    Progress,
)

FRAME_ID = 'chamber'
OUTPUTS: dict[str, type] = {
    track.topic: message_class(track.message_type)
    for track in TRACKS
    if track.topic.startswith('chamber/') and track.message_type in VALUE_OF_MESSAGE
}
"""Topics of a chamber's readings; values it does not report are not published."""


def chamber_messages(snapshot: RunSnapshot) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of everything the chamber reports, where it is to be published."""
    reading = snapshot.reading
    if reading is None or not snapshot.publish_due:
        return
    temperatures = {
        'chamber/setpoint': reading.setpoint,
        'chamber/temperature': reading.air,
        'chamber/temperature_2': reading.air_2,
        'chamber/device_temperature': reading.device,
    }
    for topic, value in temperatures.items():
        if value is not None:
            sample = TemperatureSample(snapshot.stamp, value, frame_id=FRAME_ID)
            yield topic, temperature_from_sample(sample)
    if reading.humidity is not None:
        yield 'chamber/humidity', humidity_message(snapshot.stamp, reading.humidity, FRAME_ID)
    states = {'heater': reading.heater, 'compressor': reading.compressor, 'fan': reading.fan}
    for name, state in states.items():
        if state is not None:
            yield f'chamber/{name}', float_message(state)


def output_types(*, temperatures: bool) -> dict[str, type]:
    """Return message type by topic, with or without the chamber's temperatures."""
    return {
        topic: kind
        for topic, kind in OUTPUTS.items()
        if temperatures or 'temperature' not in topic
    }


def latched_texts(run: Run) -> dict[str, str]:
    """Return the text of chamber/run and, during the run, of chamber/phase."""
    sequencer = run.conductor.sequencer
    step, mode = sequencer.step, sequencer.progress.mode
    texts = {RUN_TOPIC: _announcement(run, step, under_way=mode in (*CONTROLLING, SAFE)).text()}
    if mode in CONTROLLING:
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


def ready_message(run: Run, node: str) -> str:
    """Return the line that says which run is ready and how it is started."""
    sequencer = run.conductor.sequencer
    done = f', from step {sequencer.progress.step + 1} on' if run.resumed else ''
    return (
        f'{sequencer.profile.name} is ready, {len(sequencer.steps)} steps{done}; nothing moves '
        f'until: ros2 service call {node}/start std_srvs/srv/Trigger'
    )


def run_status(snapshot: RunSnapshot, run: Run) -> tuple[int, str, dict[str, Any]]:
    """Return level, line and values of a run for diagnostics."""
    progress, link = snapshot.progress, run.conductor.link
    waiting = progress.mode in (PAUSED, HOLD_FAULT) or progress.stage == CONFIRM
    level = 2 if progress.mode in (SAFE, ABORTED) else int(waiting or bool(snapshot.fault))
    line = progress.mode if progress.mode != RUN else f'{progress.mode} {snapshot.step.id}'
    detail = snapshot.prompt or progress.reason or snapshot.fault
    reading = snapshot.reading
    phase_left, run_left = time_left(run.conductor.sequencer.steps, progress, snapshot.dwelt_s)
    values = {
        'mode': progress.mode,
        'step': snapshot.step.id,
        'step_number': f'{progress.step + 1}/{len(run.conductor.sequencer.steps)}',
        'stage': progress.stage,
        'cycle': snapshot.step.cycle,
        'orientation': snapshot.step.orientation or 'not stated',
        'programmed [°C]': progress.setpoint if progress.setpoint is not None else 'none',
        'air [°C]': reading.air if reading else 'unknown',
        'dwell [s]': f'{snapshot.dwelt_s:.0f} of {snapshot.step.dwell_s:.0f}',
        'phase_left [s]': f'{phase_left:.0f}',
        'run_left [s]': f'{run_left:.0f}',
        'prompt': snapshot.prompt or 'none',
        'reason': progress.reason or 'none',
        'interruptions': progress.interruptions,
        'chamber': link.identity or 'not reached yet',
        'limits_programmed': link.chamber.programs_limits,
        'link': link.status,
        'link_failures': link.failures,
        'complaint': snapshot.fault or 'none',
        'run_directory': str(run.directory),
        'resumed': run.resumed,
    }
    return level, f'{line}: {detail}' if detail else line, values


def time_left(steps: Sequence[Step], progress: Progress, dwelt_s: float) -> tuple[float, float]:
    """Return the time left of the phase and of the run by the profile [s of the chamber].

    Stabilisation comes on top. A run not yet started begins at its first target.
    """
    if progress.mode in FINISHED or progress.stage == STOP:
        return 0.0, 0.0
    current, *later = steps[progress.step :]
    parts = [_step_time_left(current, progress, dwelt_s)]
    for before, step in pairwise([current, *later]):
        parts.append(step.ramp_s(before.target_c) + step.hold_s)
    names = [(step.phase, step.cycle) for step in (current, *later)]
    in_phase = len(list(takewhile(lambda name: name == names[0], names)))
    return sum(parts[:in_phase]), sum(parts)


def _step_time_left(step: Step, progress: Progress, dwelt_s: float) -> float:
    setpoint = step.target_c if progress.setpoint is None else progress.setpoint
    ramp = step.ramp_s(setpoint) if progress.stage == MOVE else 0.0
    held = dwelt_s if progress.stage == DWELL else 0.0
    return ramp + max(step.hold_s - held, 0.0)
