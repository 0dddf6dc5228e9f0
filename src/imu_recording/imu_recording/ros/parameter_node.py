# SPDX-License-Identifier: Apache-2.0
"""A node whose parameters are the fields of a frozen dataclass: types, bounds, changes in use."""

from __future__ import annotations

import threading
from collections.abc import Collection, Mapping
from dataclasses import Field, fields, replace
from typing import Any, ClassVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter

from imu_recording.ros.parameter import (
    NodeConfig,
    ParameterError,
    checked,
    converted,
    default_of,
    listed,
    unknown_parameters,
)

ACTIVE = 'active'
INACTIVE = 'inactive'
UNCONFIGURED = 'unconfigured'


class ParameterNode(LifecycleNode):  # type: ignore[misc]
    """Declares the fields of `config_class` as parameters, of the type that their default has.

    Whoever configures the node makes `config` of `_values()`; what is set afterwards is checked
    and, where it is dynamic, handed to `reconfigured`. `known_elsewhere` names parameters that
    other nodes of the process have.
    """

    config_class: ClassVar[type[NodeConfig]] = NodeConfig
    config: NodeConfig

    def __init__(
        self,
        name: str,
        *,
        parameters: Mapping[str, Any] | None = None,
        known_elsewhere: Collection[str] = (),
        **node_options: Any,
    ) -> None:
        self.lock = threading.RLock()
        overrides = [Parameter(key, value=value) for key, value in (parameters or {}).items()]
        super().__init__(name, parameter_overrides=overrides, **node_options)
        self._fields = {item.name: item for item in fields(self.config_class)}
        for item in self._fields.values():
            given = self._parameter_overrides.get(item.name)
            if given is not None:
                if item.metadata['bounds']:  # told here, as rcl's words are hard to read
                    checked(item, given.value)
                self._parameter_overrides[item.name] = self._typed(given)
            descriptor = parameter_descriptor(item)
            self.declare_parameter(item.name, ros_value(default_of(item)), descriptor)
        self.add_pre_set_parameters_callback(self._all_typed)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        known = {*self._fields, *known_elsewhere}
        for note in unknown_parameters(self._parameter_overrides, known):
            self.get_logger().warning(note)

    def reconfigured(self, config: Any) -> None:
        """Take over dynamic parameters that changed while configured."""

    @property
    def state(self) -> str:
        """Lifecycle state: 'unconfigured', 'inactive', 'active' …"""
        return str(self._state_machine.current_state[1])

    def _values(self) -> dict[str, Any]:
        values = {name: self.get_parameter(name).value for name in self._fields}
        return {
            name: [] if isinstance(value, list) and value == [''] else value
            for name, value in values.items()
        }

    def _typed(self, given: Parameter) -> Parameter:
        """Return a parameter of the type it is declared with, or raise ParameterError."""
        value = ros_value(converted(self._fields[given.name], given.value))
        return Parameter(given.name, value=value)

    def _all_typed(self, changes: list[Parameter]) -> list[Parameter]:
        """Return the parameters, whole numbers as doubles where those are declared."""
        typed = []
        for change in changes:
            if change.name not in self._fields:
                typed.append(change)
                continue
            try:
                typed.append(self._typed(change))
            except ParameterError:  # the declared type refuses it
                typed.append(change)
        return typed

    def _new(self, change: Parameter) -> bool:
        now = self.get_parameter(change.name)
        return bool(change.get_parameter_value() != now.get_parameter_value())

    def _on_set_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        own = [change for change in changes if change.name in self._fields and self._new(change)]
        running = self.state in (INACTIVE, ACTIVE)  # while configuring, presets may be filled in
        try:
            values = {c.name: checked(self._fields[c.name], c.value) for c in own}
            fixed = [name for name in values if not self._fields[name].metadata['dynamic']]
            if running and fixed:
                raise ParameterError(
                    f'{fixed[0]} takes effect at configuration: deactivate and clean up first'
                )
            if running and values:
                config = replace(self.config, **values)
                with self.lock:
                    self.reconfigured(config)
                    self.config = config
        except (ValueError, OSError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def ros_value(value: Any) -> Any:
    """Return a value that has a type in rclpy: an empty list has none, `_values` turns it back."""
    return [''] if value == [] else value


def parameter_descriptor(item: Field[Any]) -> ParameterDescriptor:
    """Return the descriptor of a field declared by `parameter`."""
    metadata = item.metadata
    unit = f' [{metadata["unit"]}]' if metadata['unit'] else ''
    choices = f'; one of {listed(metadata["choices"])}' if metadata['choices'] else ''
    descriptor = ParameterDescriptor(description=f'{metadata["description"]}{unit}{choices}')
    if metadata['bounds']:
        low, high = metadata['bounds']
        descriptor.additional_constraints = f'{low:g} … {high:g}'
        if isinstance(default_of(item), int):
            bounds = IntegerRange(from_value=int(low), to_value=int(high))
            descriptor.integer_range = [bounds]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
    return descriptor
