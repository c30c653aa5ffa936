"""Stages and their wiring: the one path for live, replay and prediction."""

from robot_energy.pipeline.energy_pipeline import EnergyPipeline, Output
from robot_energy.pipeline.friction_stage import FrictionStage
from robot_energy.pipeline.power_stage import PowerStage
from robot_energy.pipeline.settings import Settings
from robot_energy.pipeline.torque_stage import TorqueStage

__all__ = [
    "EnergyPipeline",
    "FrictionStage",
    "Output",
    "PowerStage",
    "Settings",
    "TorqueStage",
]
