"""Online energy monitoring of robots: the power chain from joint states to the outlet.

``import robot_energy as re`` gives the public API. Its parts are imported when they are first
used, so that the import itself is quick and needs neither Pinocchio, scipy nor matplotlib.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.3.0"

# Public names by their module; `:` where a name is another one there. Those of the companions are
# found by this table alone: the core imports none of them.
_NAMES = {
    "": ("physics",),
    "robot_energy.foundation.errors": (
        "BagError", "DatasetError", "HistoryError", "ImplausibleIdentificationError",
        "LogFormatError", "MissingTopicError", "ModelFileError", "MotionError",
        "NotIdentifiableError", "ParameterError", "PayloadError", "ReportError",
        "RobotDescriptionError", "RobotEnergyError", "ShapeError", "UnknownJointError",
    ),
    "robot_energy.model": ("RobotModel", "load_model:load", "save_model:save"),
    "robot_energy.model.payload": ("Payload",),
    "robot_energy.pipeline": ("EnergyPipeline", "PipelineSettings:Settings"),
    "robot_energy.pipeline.online_monitor": ("OnlineMonitor",),
    "robot_energy.replay.api": ("ReplayResult", "replay"),
    "robot_energy.results.energy": (
        "EnergyBreakdown", "JointEnergy", "MeterComparison", "PhaseEnergy",
    ),
    "robot_energy.results.replay": ("ReplayReport",),
    "robot_energy.timeline.blocks": ("Phase", "Quality"),
    "robot_energy.timeline.time_series": ("TimeSeries",),
    "robot_energy_fleet.advice.advise": ("AdviceResult", "advise"),
    "robot_energy_fleet.api": ("fleet_identify", "fleet_report", "fleet_run"),
    "robot_energy_fleet.results.advice": ("AdviceReport",),
    "robot_energy_fleet.results.fleet": ("FleetFriction", "FleetReport", "FleetRunReport"),
    "robot_energy_history.api": (
        "History", "history", "history_events", "history_friction", "history_jobs",
    ),
    "robot_energy_history.savings": ("EnergyBaseline", "EnergySavings", "history_savings"),
    "robot_energy_identify.api.evaluate": ("evaluate",),
    "robot_energy_identify.api.identify": (
        "IdentificationResult", "identify_all", "identify_auxiliary", "identify_cabinet",
        "identify_dynamics", "identify_friction", "identify_thermal",
    ),
    "robot_energy_identify.results.evaluation": ("EvaluationReport",),
    "robot_energy_identify.stats.systematic": ("SensorLimits",),
    "robot_energy_plan.api.optimize": ("OptimizationResult", "optimize"),
    "robot_energy_plan.api.predict": ("PredictionResult", "predict"),
    "robot_energy_plan.api.shared_bus": ("SharedBusResult", "shared_bus"),
    "robot_energy_plan.motion.load_motion": ("ToolOptions",),
    "robot_energy_plan.optimization.rest_states": ("RestState",),
    "robot_energy_plan.results.optimization": ("OptimizationReport",),
    "robot_energy_plan.results.prediction": ("PredictionReport",),
    "robot_energy_plan.results.shared_bus": ("SharedBusReport",),
}  # fmt: skip
_EXPORTS = {
    public: (module, original or public)
    for module, names in _NAMES.items()
    for public, _, original in (name.partition(":") for name in names)
}
# Type checkers read `__init__.pyi`.
__all__ = sorted(_EXPORTS)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__]
        )
    module, original = _EXPORTS[name]
    if not module:
        return import_module(f"{__name__}.{name}")
    try:
        value = getattr(import_module(module), original)
    except ModuleNotFoundError as error:
        from robot_energy.foundation.extras import is_ours, missing

        if error.name is None or not is_ours(error.name):
            raise
        raise missing(error.name, f"{__name__}.{name}") from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, "__version__"})


class _Face(ModuleType):
    """This module, in which `replay` is the verb, not the package that holds it."""

    def __setattr__(self, name: str, value: Any) -> None:
        # The import of a package sets it in the one above, which would hide the verb.
        if not (name == "replay" and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
