# SPDX-License-Identifier: Apache-2.0
"""Driver, compensation, filters and recorder in one process: samples pass as values, not messages.

Every stage is the node it is as a process of its own: name, parameters, lifecycle, diagnostics,
topics. A message is made only for a topic that somebody outside subscribes to.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields
from typing import Any, Final

from imu_driver.node import ImuDriverNode
from imu_recording.recorder.node import RecorderNode
from imu_recording.ros.exchange import Exchange
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.parameter import NodeConfig, config_from_values, parameter
from imu_recording.ros.parameter_node import ACTIVE, INACTIVE
from imu_recording.ros.run_node import run_node
from imu_recording.user_error import UserError
from orientation_filters.node import AhrsFilterNode, ComplementaryFilterNode
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from thermal_comp.node import ThermalCompNode

FILTERS: Final = {
    'none': (),
    'complementary': (ComplementaryFilterNode,),
    'ahrs': (AhrsFilterNode,),
    'both': (ComplementaryFilterNode, AhrsFilterNode),
}
TOPIC_TRANSPORT: Final = 'topic'
"""Value of `transport` where another driver publishes the samples."""


@dataclass(frozen=True)
class ChainConfig(NodeConfig):
    """Parameters of imu_chain; the stages have their own under their names."""

    transport: str = parameter(
        '',
        "Source: as of imu_driver (empty: what is set there), or 'topic': imu/data_raw, imu/mag "
        'and imu/temperature of another driver, remapped',
    )
    model: str = parameter('', 'Path of the thermal model; empty: nothing is compensated')
    filter: str = parameter('ahrs', 'Orientation filter', choices=tuple(FILTERS))
    record: str = parameter('', 'Folder of the bag; empty: nothing is recorded')


STAGE_PARAMETERS: Final = ('transport', 'model', 'filter', 'record')
"""Parameters that decide which stages there are."""
STAGES: Final = (
    ImuDriverNode,
    ThermalCompNode,
    ComplementaryFilterNode,
    AhrsFilterNode,
    RecorderNode,
)
PARAMETERS: Final = {item.name for node in STAGES for item in fields(node.config_class)} | {
    item.name for item in fields(ChainConfig)
}


class ImuChainNode(ConfiguredNode):
    """Hosts driver, compensation, filters and recorder; takes them through their lifecycle.

    The filters listen to imu_compensated/… where there is a model, else to imu/…, and publish
    imu/data; two of them imu/data_complementary and imu/data_ahrs. Parameters of a stage are
    given as for its own process; -p without a node's name reaches every stage that has it.
    """

    config_class = ChainConfig
    task = 'stages'
    event_driven = True
    config: ChainConfig

    def __init__(self, **options: Any) -> None:
        super().__init__('imu_chain', known_elsewhere=PARAMETERS, **options)
        self._built = config_from_values(ChainConfig, self._values())
        options.pop('parameters', None)
        known = PARAMETERS | self._parameter_overrides.keys()  # this node names unknown ones
        shared = {**options, 'exchange': Exchange(), 'known_elsewhere': known}
        self.hosted = self._stages(self._built, shared)

    def _stages(self, config: ChainConfig, shared: dict[str, Any]) -> list[ConfiguredNode]:
        """Return the nodes in the order in which samples pass through them."""
        stages: list[ConfiguredNode] = []
        if config.transport != TOPIC_TRANSPORT:
            source = {'transport': config.transport} if config.transport else {}
            stages.append(ImuDriverNode(parameters=source, **shared))
        if config.model:
            stages.append(ThermalCompNode(parameters={'model': config.model}, **shared))
        for node_class in FILTERS[config.filter]:
            name = node_class.filter_name if config.filter == 'both' else ''
            remaps = filter_remaps(name, compensated=bool(config.model))
            stages.append(node_class(cli_args=remaps or None, **shared))
        if config.record:
            recorded = {'output': config.record, **origin_of(config.transport)}
            stages.append(RecorderNode(parameters=recorded, **shared))
        return stages

    def setup(self, config: ChainConfig) -> None:
        """Configure the stages, first to last: each finds the publisher it takes samples from."""
        for name in STAGE_PARAMETERS:
            if (wanted := getattr(config, name)) != getattr(self._built, name):
                raise UserError(
                    f'{name} takes effect when the process starts: start it again with '
                    f'{name}:={wanted}, or set parameters of the stages'
                )
        for stage in self.hosted:
            if stage.state == 'unconfigured':
                stage.trigger_configure()
            if stage.state == 'unconfigured':
                self._clean_up()
                raise UserError(f'{stage.get_name()}: {stage.refused}')

    def activated(self) -> None:
        """Activate the stages, last to first: subscribers are active before the first sample."""
        for stage in reversed(self.hosted):
            if stage.state == INACTIVE:
                stage.trigger_activate()

    def deactivated(self) -> None:
        """Deactivate the stages, first to last: what is under way still arrives."""
        for stage in self.hosted:
            if stage.state == ACTIVE:
                stage.trigger_deactivate()

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release what the stages hold."""
        self._clean_up()
        return super().on_cleanup(state)

    def _clean_up(self) -> None:
        for stage in self.hosted:
            if stage.state == INACTIVE:
                stage.trigger_cleanup()

    def end(self) -> None:
        """End the stages, too, whether or not this node is active."""
        super().end()
        for stage in self.hosted:
            stage.end()

    def destroy_node(self) -> None:
        """Destroy the stages, too; first to last, so that nothing is sent to one that is gone."""
        for stage in self.hosted:
            stage.end()
        for stage in self.hosted:
            stage.destroy_node()
        super().destroy_node()

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """Return the state of every stage; a warning where one is not active."""
        states = {stage.get_name(): stage.state for stage in self.hosted}
        idle = [f'{name} is {state}' for name, state in states.items() if state != ACTIVE]
        waits = bool(idle) and self.state == ACTIVE
        return int(waits), '; '.join(idle) if waits else self.state, dict(states)


def filter_remaps(name: str, *, compensated: bool) -> list[str]:
    """Return the arguments that connect a filter; `name` where it is one of several, else ''.

    >>> filter_remaps('ahrs', compensated=False)
    ['--ros-args', '-r', 'imu/data:=imu/data_ahrs']
    >>> filter_remaps('', compensated=True)[1:]
    ['-r', 'imu/data_raw:=imu_compensated/data_raw', '-r', 'imu/mag:=imu_compensated/mag']
    """
    renamed = ('data_raw', 'mag') if compensated else ()
    rules = [f'imu/{topic}:=imu_compensated/{topic}' for topic in renamed]
    if name:
        rules.append(f'imu/data:=imu/data_{name}')
    remaps = [word for rule in rules for word in ('-r', rule)]
    return ['--ros-args', *remaps] if remaps else []


def origin_of(transport: str) -> dict[str, list[str]]:
    """Return the recorder's `metadata` that marks what a simulated board sent.

    >>> origin_of('simulated://dut1')
    {'metadata': ['simulated=simulated://dut1']}
    >>> origin_of('/dev/ttyACM0')
    {}
    """
    simulated = transport.startswith('simulated://')
    return {'metadata': [f'simulated={transport}']} if simulated else {}


def main() -> int:
    """Run the chain."""
    sys.setswitchinterval(5e-4)  # [s] to the next thread; 5 ms by default
    return run_node(ImuChainNode)
