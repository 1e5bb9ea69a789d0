"""A node whose parameters can be set to what they are, as `ros2 param load` does with all of a file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from sma_sim.model.config import suggestion

Type = Parameter.Type


class ParameterNode(Node):
    """A node that answers requests for parameters in words that say what to do.

    A read-only parameter may be given the value that it has; a request for another one is refused, with both values. A
    number may come as an integer or as a text (`ros2 param load` sends 1e-05 so).
    """

    def set_parameters_atomically(self, parameter_list: list[Any]) -> SetParametersResult:
        """Set all of the parameters, or none; the services of the node call this."""
        wanted = []
        for parameter in parameter_list:
            if not self.has_parameter(parameter.name):
                names = [known for known in self.list_parameters([], 0).names if not known.startswith('qos_overrides.')]
                reason = f'unknown parameter {parameter.name}{suggestion(parameter.name, names)}'
                return SetParametersResult(successful=False, reason=reason)
            given, present = self._as_declared(parameter), self.get_parameter(parameter.name)
            if same_value(given.value, present.value):
                continue
            if self.describe_parameter(parameter.name).read_only:
                return SetParametersResult(successful=False, reason=fixed(given, present.value))
            wanted.append(given)
        return super().set_parameters_atomically(wanted) if wanted else SetParametersResult(successful=True)

    def _as_declared(self, parameter: Any) -> Any:
        """The parameter with its declared type, where its value can be read so."""
        kind, value = self.get_parameter(parameter.name).type_, parameter.value
        if kind == Type.DOUBLE and parameter.type_ in (Type.INTEGER, Type.STRING):
            try:
                return Parameter(parameter.name, Type.DOUBLE, float(value))
            except ValueError:
                return parameter
        if kind == Type.STRING and parameter.type_ in (Type.INTEGER, Type.DOUBLE):  # a text that reads as a number
            return Parameter(parameter.name, Type.STRING, str(value))
        return parameter


def same_value(given: Any, present: Any) -> bool:
    """Whether two values are the same; NaN is NaN, and an empty text in a list, which ROS needs to write it, is nothing."""
    if isinstance(given, float) and isinstance(present, float):
        return given == present or math.isnan(given) and math.isnan(present)
    if isinstance(given, Sequence) and isinstance(present, Sequence) and not isinstance(given, str):
        return [entry for entry in given if entry != ''] == [entry for entry in present if entry != '']
    return type(given) is type(present) and bool(given == present)


def fixed(parameter: Any, present: Any) -> str:
    """Why a read-only parameter isn't set, and what can be done."""
    name, value = parameter.name, parameter.value
    return (
        f'{name} is read-only while the node runs: it is {present!r}, not {value!r}. Give it when the node starts, with '
        f'-p {name}:={value} or in a file with --params-file'
    )
