# SPDX-License-Identifier: Apache-2.0
"""Record each run that a chamber announces to a bag of its own."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from imu_recording.bags.metadata import Qos
from imu_recording.free_space import standing_folder
from imu_recording.logging_contract import MESSAGES_LOST, PHASE_TOPIC
from imu_recording.recorder.bag_recorder import BagRecorder
from imu_recording.recorder.plan import RecorderConfig, further_output, is_wanted, recording_plan
from imu_recording.recorder.run_announcement import RunAnnouncement
from imu_recording.recording import BagError

FLUSHES_WAITED = 5
"""Flushes during which messages are held back for a chamber that has not announced its run."""

Message = tuple[str, str, bytes, int, Sequence[Qos]]
"""Topic, type, bytes, time of receipt [ns], offered QoS."""


class RunRecorder:
    """Records to the bag of the run announced last; without an announcement, all to one bag.

    The first messages wait until the next flush for an announcement, which tells their bag. Every
    further bag begins with the newest message of each latched topic.
    """

    def __init__(self, config: RecorderConfig, output: Path) -> None:
        self.config = config
        self.output = output
        self.plan = recording_plan(config, output, RunAnnouncement())
        _check_writable(output)
        self._announcement = RunAnnouncement()
        self._noted: dict[str, str] = {}
        self._bag = self._interrupted_bag()
        self._taken = 0
        self._held: list[Message] | None = []
        self._flushes = 0
        self._wanted: dict[str, bool] = {}
        self._latched: dict[str, Message] = {}

    @property
    def repaired(self) -> Mapping[Path, int]:
        """Files of the bag that a kill had cut, and how many messages each of them has."""
        return self._bag.repaired if self._bag else {}

    @property
    def messages(self) -> int:
        """Messages taken so far."""
        return self._taken + len(self._held or ())

    def needs(self, topic: str) -> bool:
        """Return whether to listen to a topic: the phase also where it is not recorded."""
        return is_wanted(topic, self.plan.topics) or topic.endswith(f'/{PHASE_TOPIC}')

    def follow(self, announcement: RunAnnouncement, received: int) -> None:
        """Record the run announced from now on; BagError where its bag cannot be written."""
        known = self._announcement.directory
        if known and announcement.directory != known and self._taken:
            self.output = further_output(self.output)
        plan = recording_plan(self.config, self.output, announcement)
        self._announcement = announcement
        if plan == self.plan and self._held is None:
            return
        self._close_bag()
        before, self.plan, self._wanted = self.plan, plan, {}
        first, self._held = self._held, None
        if first is None and plan.folder != before.folder:
            first = self._repeated(received)
        for message in (first or ()) if plan.folder else ():
            self._write(message)

    def record(
        self, topic: str, message_type: str, data: bytes, received: int, qos: Sequence[Qos] = ()
    ) -> None:
        """Take one serialised message."""
        message = (topic, message_type, data, received, qos)
        if any(profile['durability'] == 'transient_local' for profile in qos):
            self._latched[topic] = message
        if self._held is not None:
            self._held.append(message)
        elif self.plan.folder is not None:
            self._write(message)

    def flush(self, *, expecting: bool = False) -> None:
        """Put everything on disk.

        `expecting` an announcement, hold the first messages back for FLUSHES_WAITED flushes.
        """
        if self._held:
            self._flushes += 1
            if not expecting or self._flushes > FLUSHES_WAITED:
                held, self._held = self._held, None
                for message in held:
                    self._write(message)
        if self._bag is not None:
            self._bag.flush()

    def note_losses(self, lost: Mapping[str, int]) -> None:
        """Say in the bag's metadata how many messages of each topic did not arrive."""
        if self._bag is not None and lost:
            listed = ', '.join(f'{topic} {number}' for topic, number in lost.items())
            self._bag.note(MESSAGES_LOST, listed)

    def note(self, key: str, value: str) -> None:
        """Say in the metadata of this bag and of all that follow where the data come from."""
        self._noted[key] = value
        if self._bag is not None:
            self._bag.note(key, value)

    def noted(self, key: str) -> str:
        """Return what `note` said before; '' nothing."""
        return self._noted.get(key, '')

    def close(self) -> None:
        """Finish the bag."""
        self.flush()
        self._close_bag()

    def _write(self, message: Message) -> None:
        topic, message_type, data, received, qos = message
        wanted = self._wanted.get(topic)
        if wanted is None:
            wanted = self._wanted[topic] = is_wanted(topic, self.plan.topics)
        if self._bag is None:
            self._bag = self._open_bag()
        if wanted:
            self._bag.record(topic, message_type, data, received, qos=qos)
            self._taken += 1
        elif topic.endswith(f'/{PHASE_TOPIC}'):
            self._bag.follow_phase(data)

    def _interrupted_bag(self) -> BagRecorder | None:
        """Return the bag that is there already, its files repaired where they were cut."""
        folder = self.plan.folder
        is_there = folder is not None and any(folder.glob(f'{folder.name}_*.mcap'))
        return self._open_bag() if is_there else None

    def _repeated(self, received: int) -> list[Message]:
        return [(t, kind, data, received, qos) for t, kind, data, _, qos in self._latched.values()]

    def _open_bag(self) -> BagRecorder:
        plan = self.plan
        assert plan.folder is not None  # noqa: S101 (callers checked)
        return BagRecorder(
            plan.folder,
            metadata={**plan.metadata, **self._noted},
            split_at_phase=plan.at_phase,
            split_bytes=plan.split_bytes,
        )

    def _close_bag(self) -> None:
        if self._bag is not None:
            bag, self._bag = self._bag, None
            bag.close()


def _check_writable(output: Path) -> None:
    """Refuse a folder that cannot be written before anything is lost."""
    place = standing_folder(output)
    if not (place.is_dir() and os.access(place, os.W_OK)):
        raise BagError(f'{output}: cannot be written ({place} is no folder to write to)')
