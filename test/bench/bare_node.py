"""`energy_monitor` without bands, for what they cost; learner and observer have switches."""

import sys

from bench_pipeline import without_bands

from ros2_energy_monitor.nodes import energy_monitor

pipeline = energy_monitor.EnergyPipeline
energy_monitor.EnergyPipeline = lambda *arguments: without_bands(pipeline(*arguments))
sys.exit(energy_monitor.main())
