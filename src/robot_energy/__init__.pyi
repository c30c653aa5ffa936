"""Types of the public names, which `__init__.py` imports when they are first used."""

from robot_energy import physics
from robot_energy.foundation.errors import (
    BagError,
    DatasetError,
    HistoryError,
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
from robot_energy_fleet.advice.advise import AdviceResult, advise
from robot_energy_fleet.api import fleet_identify, fleet_report, fleet_run
from robot_energy_fleet.results.advice import AdviceReport
from robot_energy_fleet.results.fleet import FleetFriction, FleetReport, FleetRunReport
from robot_energy_history.api import (
    History,
    history,
    history_events,
    history_friction,
    history_jobs,
)
from robot_energy_history.savings import EnergyBaseline, EnergySavings, history_savings
from robot_energy_identify.api.evaluate import evaluate
from robot_energy_identify.api.identify import (
    IdentificationResult,
    identify_all,
    identify_auxiliary,
    identify_cabinet,
    identify_dynamics,
    identify_friction,
    identify_thermal,
)
from robot_energy_identify.results.evaluation import EvaluationReport
from robot_energy_identify.stats.systematic import SensorLimits
from robot_energy_plan.api.optimize import OptimizationResult, optimize
from robot_energy_plan.api.predict import PredictionResult, predict
from robot_energy_plan.api.shared_bus import SharedBusResult, shared_bus
from robot_energy_plan.motion.load_motion import ToolOptions
from robot_energy_plan.optimization.rest_states import RestState
from robot_energy_plan.results.optimization import OptimizationReport
from robot_energy_plan.results.prediction import PredictionReport
from robot_energy_plan.results.shared_bus import SharedBusReport

__version__: str
__all__ = [
    "AdviceReport", "AdviceResult", "BagError", "DatasetError", "EnergyBaseline", "EnergyBreakdown",
    "EnergyPipeline", "EnergySavings", "EvaluationReport", "FleetFriction", "FleetReport",
    "FleetRunReport", "History", "HistoryError", "IdentificationResult",
    "ImplausibleIdentificationError", "JointEnergy", "LogFormatError", "MeterComparison",
    "MissingTopicError", "ModelFileError", "MotionError", "NotIdentifiableError", "OnlineMonitor",
    "OptimizationReport", "OptimizationResult", "ParameterError", "Payload", "PayloadError",
    "Phase", "PhaseEnergy", "PipelineSettings", "PredictionReport", "PredictionResult", "Quality",
    "ReplayReport", "ReplayResult", "ReportError", "RestState", "RobotDescriptionError",
    "RobotEnergyError", "RobotModel", "SensorLimits", "ShapeError", "SharedBusReport",
    "SharedBusResult", "TimeSeries", "ToolOptions", "UnknownJointError", "advise", "evaluate",
    "fleet_identify", "fleet_report", "fleet_run", "history", "history_events", "history_friction",
    "history_jobs", "history_savings", "identify_all", "identify_auxiliary", "identify_cabinet",
    "identify_dynamics", "identify_friction", "identify_thermal", "load_model", "optimize",
    "physics", "predict", "replay", "save_model", "shared_bus",
]  # fmt: skip
