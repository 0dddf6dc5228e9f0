# SPDX-License-Identifier: Apache-2.0
"""Topics of samples: values to nodes of the same process, messages to others if there are any."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from time import monotonic
from typing import Any

from imu_recording.ros.sample_bytes import SampleForm

Take = Callable[[Any], None]

COUNT_PERIOD_S = 0.1
"""Subscribers are counted so often [s]: much less than a topic takes to be discovered."""


@dataclass
class LocalTopic:
    """Callbacks of this process on a topic, and its outputs here."""

    samples: tuple[Take, ...] = ()
    """Callbacks that take samples."""
    serialised: tuple[Take, ...] = ()
    """Callbacks that take serialised messages."""
    offered: int = 0
    """Number of the topic's outputs in this process."""

    def withdraw(self) -> None:
        """Take note that one of its outputs has ended."""
        self.offered -= 1

    def listen(self, take: Take, *, serialised: bool) -> Callable[[], None]:
        """Hand what is sent to `take` from now on; return the call that ends it."""
        name = 'serialised' if serialised else 'samples'  # a new tuple: a sender may iterate
        setattr(self, name, (*getattr(self, name), take))
        return lambda: setattr(self, name, tuple(t for t in getattr(self, name) if t != take))


class Outbox:
    """Sends serialised messages: at once, or within `with` all together at its end.

    Sent together, the data of the chain's stages and of the middleware stay in the processor's
    cache in turn; alternating, each would evict the other's.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[Any, bytes]] = deque()
        self._holds = False
        self._sending = Lock()

    def put(self, handle: Any, data: bytes) -> None:
        """Send a message by this handle of a publisher, after those put before."""
        self._waiting.append((handle, data))
        if not self._holds:
            self._send()

    def __enter__(self) -> None:
        self._holds = True

    def __exit__(self, *_: object) -> None:
        self._holds = False
        self._send()

    def _send(self) -> None:
        with self._sending:  # keeps the order of two threads
            while self._waiting:
                handle, data = self._waiting.popleft()
                with handle:
                    handle.publish_raw(data)  # what `publish` does with bytes


class Exchange:
    """The topics of nodes that share a process, by full name.

    A node that listens to a topic which a node of the process offers is called with its samples,
    in the thread and at the moment of sending; no message is made for it.
    """

    def __init__(self) -> None:
        self.outbox = Outbox()
        self._topics: dict[str, LocalTopic] = {}

    def topic(self, name: str) -> LocalTopic:
        """Return the topic of this full name."""
        return self._topics.setdefault(name, LocalTopic())

    def offers(self, name: str) -> bool:
        """Tell whether a node of this process sends on the topic."""
        return name in self._topics and self._topics[name].offered > 0


class SampleOutput:
    """Sends samples while its node is active; serialises one only if somebody asks for bytes."""

    def __init__(
        self, publisher: Any, form: SampleForm, local: LocalTopic, outbox: Outbox
    ) -> None:
        self._publisher = publisher
        self._handle = publisher.handle
        self._outbox = outbox
        self._to_bytes = form.to_bytes
        self._local = local
        self._has_subscribers = False
        self._counted_at = float('-inf')

    def send(self, sample: Any) -> None:
        """Send a sample."""
        publisher, local = self._publisher, self._local
        if not publisher.is_activated:
            return
        now = monotonic()
        if now - self._counted_at > COUNT_PERIOD_S:
            self._has_subscribers = publisher.get_subscription_count() > 0
            self._counted_at = now
        if local.serialised or self._has_subscribers:
            data = self._to_bytes(sample)
            self._outbox.put(self._handle, data)
            for take in local.serialised:
                take(data)
        for take in local.samples:
            take(sample)


class CapturedOutput:
    """Stands in for an output: hands every message to a function instead of DDS."""

    def __init__(self, publisher: Any, convert: Callable[[Any], Any]) -> None:
        self._publisher = publisher
        self._convert = convert

    def send(self, sample: Any) -> None:
        """Hand the message over."""
        self._publisher.publish(self._convert(sample))
