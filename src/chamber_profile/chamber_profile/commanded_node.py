# SPDX-License-Identifier: Apache-2.0
"""A node with a run that takes orders: services ~/start ~/pause ~/resume ~/abort ~/confirm."""

from __future__ import annotations

from functools import partial
from typing import Any

from imu_recording.lifecycle_node import ConfiguredNode
from rclpy.lifecycle import TransitionCallbackReturn
from std_srvs.srv import Trigger

from chamber_profile.run_thread import RunThread
from chamber_profile.sequencer import COMMANDS


class CommandedNode(ConfiguredNode):
    """Owns a run and the thread that advances it; `setup` of a subclass opens the run."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.run: Any = None
        self.exit_code: int | None = None
        """What the process shall exit with; None: it goes on."""
        self._thread: RunThread | None = None

    def advance(self) -> None:
        """One step of the run."""
        raise NotImplementedError

    def take_orders(self) -> None:
        """Open the services."""
        for name in COMMANDS:
            service = self.create_service(Trigger, f'~/{name}', self._answering(name))
            self._entities.append(partial(self.destroy_service, service))

    @property
    def in_charge(self) -> bool:
        """Whether a run is under way and the chamber depends on this process."""
        return self.run is not None and self.run.conductor.sequencer.in_charge

    def order(self, name: str) -> str:
        """Give an order (one of COMMANDS); return why it is refused, or ''."""
        refusal: str = self.run.conductor.sequencer.command(name)
        return refusal

    def activated(self) -> None:
        """Begin to watch the chamber."""
        if self._capture is None:
            self._thread = RunThread(self.advance, self.run.period_s, self.fail)

    def deactivated(self) -> None:
        """Stop watching; the chamber was made safe before, or stands by."""
        if self._thread is not None:
            self._thread.stop()
            self._thread = None

    def on_deactivate(self, state: Any) -> Any:
        """Refuse while a run is under way: abort it first."""
        if self.in_charge:
            self.get_logger().error('a run is under way: call ~/abort first')
            return TransitionCallbackReturn.FAILURE
        return super().on_deactivate(state)

    def end(self) -> None:
        """Leave nothing running that depends on this process."""
        if self.in_charge:
            self.stop_at_once()
        self.deactivated()

    def stop_at_once(self) -> None:
        """Put the chamber on stand-by without a ramp, whatever else is going on."""
        self.deactivated()
        self.run.conductor.stop_at_once()

    def fail(self) -> None:
        """Stop at once, for a reason nobody has thought of."""
        self.exit_code = 1
        self.run.conductor.stop_at_once()

    def _answering(self, name: str) -> Any:
        def answer(_: Any, response: Any) -> Any:
            refusal = self.order(name)
            response.success, response.message = not refusal, refusal or name
            return response

        return answer
