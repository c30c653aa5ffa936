"""Online energy monitoring of robots: the power chain from joint states to the outlet.

``import robot_energy as re`` gives the public API. Its parts are imported when they are first
used, so that the import itself is quick and needs neither Pinocchio, scipy nor matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.3.0"

if TYPE_CHECKING:
    from robot_energy import physics
    from robot_energy.foundation.errors import (
        BagError,
        DatasetError,
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
    from robot_energy.model.payload import Payload
    from robot_energy.pipeline import EnergyPipeline
    from robot_energy.pipeline import Settings as PipelineSettings
    from robot_energy.pipeline.online_monitor import OnlineMonitor
    from robot_energy.replay.api import ReplayResult, replay
    from robot_energy.results.energy import (
        EnergyBreakdown,
        JointEnergy,
        MeterComparison,
        PhaseEnergy,
    )
    from robot_energy.results.replay import ReplayReport
    from robot_energy.timeline.blocks import Phase, Quality
    from robot_energy.timeline.time_series import TimeSeries
    from robot_energy_fleet.advice.run import AdviceResult, advise
    from robot_energy_fleet.api import fleet_identify, fleet_report, fleet_run
    from robot_energy_fleet.results.advice import AdviceReport
    from robot_energy_fleet.results.fleet import FleetFriction, FleetReport, FleetRunReport
    from robot_energy_identify.api.evaluate import evaluate
    from robot_energy_identify.api.identify import (
        IdentificationResult,
        identify_auxiliary,
        identify_cabinet,
        identify_dynamics,
        identify_friction,
        identify_thermal,
    )
    from robot_energy_identify.api.identify_all import identify_all
    from robot_energy_identify.results.evaluation import EvaluationReport
    from robot_energy_identify.stats.systematic import SensorLimits
    from robot_energy_plan.api.optimize import OptimizationResult, optimize
    from robot_energy_plan.api.predict import PredictionResult, predict
    from robot_energy_plan.motion.load_motion import ToolOptions
    from robot_energy_plan.optimization.rest_states import RestState
    from robot_energy_plan.results.optimization import OptimizationReport
    from robot_energy_plan.results.prediction import PredictionReport

# Public names by their module; `:` where a name is another one there.
_NAMES = {
    "": ("physics",),
    "advice.run": ("AdviceResult", "advise"),
    "api.evaluate": ("evaluate",),
    "api.identify": (
        "IdentificationResult", "identify_auxiliary", "identify_cabinet", "identify_dynamics",
        "identify_friction", "identify_thermal",
    ),
    "api.identify_all": ("identify_all",),
    "api.online_monitor": ("OnlineMonitor",),
    "api.optimize": ("OptimizationResult", "optimize"),
    "api.predict": ("PredictionResult", "predict"),
    "api.replay": ("ReplayResult", "replay"),
    "blocks": ("Phase", "Quality"),
    "errors": (
        "BagError", "DatasetError", "ImplausibleIdentificationError", "LogFormatError",
        "MissingTopicError", "ModelFileError", "MotionError", "NotIdentifiableError",
        "ParameterError", "PayloadError", "ReportError", "RobotDescriptionError",
        "RobotEnergyError", "ShapeError", "UnknownJointError",
    ),
    "fleet.api": ("fleet_identify", "fleet_report", "fleet_run"),
    "identify.stats.systematic": ("SensorLimits",),
    "model": ("RobotModel", "load_model:load", "save_model:save"),
    "model.payload": ("Payload",),
    "motion.load_motion": ("ToolOptions",),
    "optimization.rest_states": ("RestState",),
    "pipeline": ("EnergyPipeline", "PipelineSettings:Settings"),
    "results.advice": ("AdviceReport",),
    "results.energy": ("EnergyBreakdown", "JointEnergy", "MeterComparison", "PhaseEnergy"),
    "results.evaluation": ("EvaluationReport",),
    "results.fleet": ("FleetFriction", "FleetReport", "FleetRunReport"),
    "results.optimization": ("OptimizationReport",),
    "results.prediction": ("PredictionReport",),
    "results.replay": ("ReplayReport",),
    "time_series": ("TimeSeries",),
}  # fmt: skip
_EXPORTS = {
    public: (module, original or public)
    for module, names in _NAMES.items()
    for public, _, original in (name.partition(":") for name in names)
}
__all__ = [
    "AdviceReport", "AdviceResult", "BagError", "DatasetError", "EnergyBreakdown",
    "EnergyPipeline", "EvaluationReport", "FleetFriction", "FleetReport", "FleetRunReport",
    "IdentificationResult", "ImplausibleIdentificationError", "JointEnergy", "LogFormatError",
    "MeterComparison", "MissingTopicError", "ModelFileError", "MotionError",
    "NotIdentifiableError", "OnlineMonitor", "OptimizationReport", "OptimizationResult",
    "ParameterError", "Payload", "PayloadError", "Phase", "PhaseEnergy", "PipelineSettings",
    "PredictionReport", "PredictionResult", "Quality", "ReplayReport", "ReplayResult",
    "ReportError", "RestState", "RobotDescriptionError", "RobotEnergyError", "RobotModel",
    "SensorLimits", "ShapeError", "TimeSeries", "ToolOptions", "UnknownJointError", "advise",
    "evaluate", "fleet_identify", "fleet_report", "fleet_run", "identify_all",
    "identify_auxiliary", "identify_cabinet", "identify_dynamics", "identify_friction",
    "identify_thermal", "load_model", "optimize", "physics", "predict", "replay", "save_model",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, original = _EXPORTS[name]
    if not module:
        return import_module(f"robot_energy.{name}")
    value = getattr(import_module(f"robot_energy.{module}"), original)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
