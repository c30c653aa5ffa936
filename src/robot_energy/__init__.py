"""Online energy monitoring of robots: the power chain from joint states to the outlet.

``import robot_energy as re`` gives the public API. Its parts are imported when they are first
used, so that the import itself is quick and needs neither Pinocchio, scipy nor matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from robot_energy import physics
    from robot_energy.api.identify import (
        IdentificationResult,
        identify_all,
        identify_cabinet,
        identify_dynamics,
        identify_friction,
    )
    from robot_energy.api.online_monitor import OnlineMonitor
    from robot_energy.api.predict import PredictionResult, predict
    from robot_energy.api.replay import ReplayResult, replay
    from robot_energy.blocks import Phase, Quality
    from robot_energy.errors import (
        BagError,
        ImplausibleIdentificationError,
        LogFormatError,
        MissingTopicError,
        ModelFileError,
        MotionError,
        NotIdentifiableError,
        ParameterError,
        PayloadError,
        ReportError,
        RobotDescriptionError,
        RobotEnergyError,
        ShapeError,
        UnknownJointError,
    )
    from robot_energy.model import RobotModel
    from robot_energy.model import load as load_model
    from robot_energy.model import save as save_model
    from robot_energy.pipeline import EnergyPipeline
    from robot_energy.pipeline import Settings as PipelineSettings
    from robot_energy.results.energy import (
        EnergyBreakdown,
        JointEnergy,
        MeterComparison,
        PhaseEnergy,
    )
    from robot_energy.time_series import TimeSeries

# Module of each public name; `:` where it has another name there.
_EXPORTS = {
    "BagError": "errors",
    "EnergyBreakdown": "results.energy",
    "EnergyPipeline": "pipeline",
    "IdentificationResult": "api.identify",
    "ImplausibleIdentificationError": "errors",
    "JointEnergy": "results.energy",
    "LogFormatError": "errors",
    "MeterComparison": "results.energy",
    "MissingTopicError": "errors",
    "ModelFileError": "errors",
    "MotionError": "errors",
    "NotIdentifiableError": "errors",
    "OnlineMonitor": "api.online_monitor",
    "ParameterError": "errors",
    "PayloadError": "errors",
    "Phase": "blocks",
    "PhaseEnergy": "results.energy",
    "PipelineSettings": "pipeline:Settings",
    "PredictionResult": "api.predict",
    "Quality": "blocks",
    "ReplayResult": "api.replay",
    "ReportError": "errors",
    "RobotDescriptionError": "errors",
    "RobotEnergyError": "errors",
    "RobotModel": "model",
    "ShapeError": "errors",
    "TimeSeries": "time_series",
    "UnknownJointError": "errors",
    "identify_all": "api.identify",
    "identify_cabinet": "api.identify",
    "identify_dynamics": "api.identify",
    "identify_friction": "api.identify",
    "load_model": "model:load",
    "physics": "",
    "predict": "api.predict",
    "replay": "api.replay",
    "save_model": "model:save",
}

__all__ = [
    "BagError",
    "EnergyBreakdown",
    "EnergyPipeline",
    "IdentificationResult",
    "ImplausibleIdentificationError",
    "JointEnergy",
    "LogFormatError",
    "MeterComparison",
    "MissingTopicError",
    "ModelFileError",
    "MotionError",
    "NotIdentifiableError",
    "OnlineMonitor",
    "ParameterError",
    "PayloadError",
    "Phase",
    "PhaseEnergy",
    "PipelineSettings",
    "PredictionResult",
    "Quality",
    "ReplayResult",
    "ReportError",
    "RobotDescriptionError",
    "RobotEnergyError",
    "RobotModel",
    "ShapeError",
    "TimeSeries",
    "UnknownJointError",
    "identify_all",
    "identify_cabinet",
    "identify_dynamics",
    "identify_friction",
    "load_model",
    "physics",
    "predict",
    "replay",
    "save_model",
]


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "physics":
        return import_module("robot_energy.physics")
    module, _, original = _EXPORTS[name].partition(":")
    value = getattr(import_module(f"robot_energy.{module}"), original or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
