"""Layers: which module may import which, for the complete list of modules.

A module that is not listed fails, so that every new one is given its place. A module imports
from its own layer and from those below; packages of one layer may use each other as long as no
cycle arises.
"""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import robot_energy

SOURCES = Path(robot_energy.__file__).parent.parent
MODULES = {
    "robot_energy": """
        __main__ bag_replay blocks config_file energy_bag errors held_rows kinds log_formats
        prediction process_memory read_ahead recorded_jobs replay_steps replay_topics schema_errors
        shown_text stopping time_series time_zone
        units
    """,
    "robot_energy.accounting": """
        account account_record auxiliary averaging band_calibration comparison energy_calibration
        energy_curve exact_sum integration job_intervals load_curve meter_checks meter_response
        plain_text prediction_errors record record_repair registers sample_counts settings
        shaft_comparison totals
    """,
    "robot_energy_fleet.advice": """
        claims dataset_evidence evidence run speeds
    """,
    "robot_energy.api": """
        condition evaluate identify identify_all inputs online_monitor optimize power_table predict
        replay
    """,
    "robot_energy.bag": """
        by_log_time mcap_block mcap_file mcap_records mcap_summary metadata ownership packed reader
        sources sqlite_source time_range writer
    """,
    "robot_energy.bag.cdr": """
        batch decode encode plan schema types walk
    """,
    "robot_energy_identify.check": """
        evidence finding hypotheses meter motion payload process remedies run torque
    """,
    "robot_energy_cli": """
        advise check command commands export fleet_identify fleet_report fleet_run help_text
        identify_all identify_drives identify_dynamics identify_excitation identify_friction
        identify_inputs identify_metered identify_thermal import_logs info
        layouts listings main models monitoring numbers optimize predict replay replay_options
        report simulate terminal test tool_options
    """,
    "robot_energy.condition": """
        baseline buckets drift_test joint_friction learner meter_fit meter_windows
        programs record thermal_observer wear wear_records
    """,
    "robot_energy.foundation.files": """
        first_bytes output_files output_folder output_streams placement private_file
        regular_file temporary_folder xml_encoding
    """,
    "robot_energy_fleet": """
        api bag_joints bag_list bag_places bag_row bag_sums dataset dataset_columns findings
        identify joint_sums merged_friction merged_laws report run sisters tables wear_history
        workers
    """,
    "robot_energy_identify": """
        bounds causes plausibility provenance run_all steps
    """,
    "robot_energy_identify.auxiliary": """
        readings states
    """,
    "robot_energy_identify.cabinet": """
        cabinet dc_link link_errors link_readings supply
    """,
    "robot_energy_identify.data": """
        bags log_channels observations recordings signals
    """,
    "robot_energy_identify.drives": """
        all_drives delays drive_data drive_power drives efficiency losses total_power
        total_sums
    """,
    "robot_energy_identify.dynamics": """
        base_parameters consistent dynamics dynamics_model leave_one_out
        sufficiency torque_model validation
    """,
    "robot_energy_identify.excitation": """
        excitation limits
    """,
    "robot_energy_identify.friction": """
        friction hold laws samples shape temperature_study
    """,
    "robot_energy_identify.stats": """
        autocorrelation cross_validation held_out_energy lag regression systematic
    """,
    "robot_energy_identify.thermal": """
        gear gears_by_meter network windows
    """,
    "robot_energy.inputs": """
        auxiliary bag_topics inputs_file parameters rejection_log sources
    """,
    "robot_energy.inputs.joint_states": """
        correction decode joint_states jumps partial_states plausibility publisher_conflicts
        velocities zero_states
    """,
    "robot_energy.inputs.meter": """
        energy_counter kinds meter power_curve source voltage_current_pairs
    """,
    "robot_energy.inputs.temperatures": """
        filter kinds reader stuck temperatures
    """,
    "robot_energy_report.layouts": """
        foxglove plotjuggler plots viewers
    """,
    "robot_energy_logs": """
        cells columns diadem instants log_import mapped_log mapping recording rows table text_table
        ur_rtde
    """,
    "robot_energy.messages": """
        friction model_messages payload power registers torque
    """,
    "robot_energy.model": """
        auxiliary drive_models figure friction_laws joint load open_schema payload
        reference schema
    """,
    "robot_energy_plan.motion": """
        fourier gcode gcode_arcs gcode_flavors gcode_machine gcode_words inverse_kinematics
        joint_trajectory load_motion planar planned point_columns ptp ptp_file ptp_loop sequence
        slicing tool_corners tool_motion tool_path tool_timing trajectory_io
    """,
    "robot_energy_plan.optimization": """
        candidates chain comparison deviations forms gcode_form levelling measures
        order place plan program_form ptp_form recorded_motion rest_states search task
        time_law timed_moves trajectory_form
    """,
    "robot_energy_report.page": """
        access alarms energy_flow headless_browser history hub json_numbers messages metrics
        monitoring phase_totals recording robot_state rows saved_page settings web_app web_server
    """,
    "robot_energy.physics": """
        cabinet collision derivative drive drivetrain effort effort_check electrical_power equations
        friction hold_torque limit_utilisation motor_heat plausibility rigid_body torque
        torque_limits transmission
    """,
    "robot_energy.physics.urdf": """
        actuators checks compare limits moving_joints parse
    """,
    "robot_energy.pipeline": """
        consecutive energy_pipeline fallback_use friction_certainty friction_stage friction_timeline
        payload_timeline power_stage settings torque_stage
    """,
    "robot_energy_report": """
        advice canvas document drives dynamics energy evaluation fleet fleet_figures formats
        friction_figure headline held_out html identification identify_all jobs kinds layout model
        optimization parameters prediction prediction_figure printing recordings repeats replay
        replay_figures series
    """,
    "robot_energy.results": """
        advice auxiliary base check condition drives dynamics energy evaluation fleet identification
        model optimization prediction replay schema
    """,
    "robot_energy_rig": """
        auxiliary config lubricant output plant profile random_plant record sensors supply
        virtual_rig
    """,
    "robot_energy_identify.starter": """
        arm description joints model_text priors
    """,
    "robot_energy.store": """
        account_store adoption condition_store envelope slot_store slots state_files
    """,
    "robot_energy.timeline": """
        coverage epochs gaps hold pieces stamps streams
    """,
    "robot_energy.certainty": """
        band deviation priors
    """,
    "robot_energy_papers": """
        accuracy advice_study band_coverage boat calibration certainty certainty_page drawings
        drive_study experiment fleet_study gear_study generated_fleet held_out interval_coverage
        job_pool judged_savings kr16_sensitivity learning_study machines mantis map_sensitivity
        models pages paper_a paper_a_page paper_b paper_b_page savings savings_page
        savings_study sensitivity soaked_rigs thermal_study wall wall_sensitivity
        wear_cycle wear_rows wear_shift wear_study
    """,
    "robot_energy_papers.cli": """
        reproduce
    """,
}
# From the ground up; each line may import from itself and from the lines above it.
LAYERS = (
    (
        "errors",
        "units",
        "kinds",
        "held_rows",
        "blocks",
        "shown_text",
        "stopping",
        "process_memory",
        "kernels",
        "time_zone",
    ),
    ("files",),
    ("config_file", "schema_errors", "model"),
    ("physics", "timeline", "cdr"),
    ("uncertainty",),
    ("bag", "inputs", "presets", "accounting", "logs", "log_formats", "time_series"),
    ("condition",),
    ("pipeline", "messages", "store"),
    ("motion",),
    (
        "bag_replay",
        "energy_bag",
        "read_ahead",
        "replay_steps",
        "replay_topics",
        "prediction",
        "recorded_jobs",
        "starter",
        "layouts",
    ),
    ("identify", "rig", "check", "page", "optimization"),
    ("results",),
    ("report",),
    ("api",),
    ("fleet",),
    ("advice",),
    ("cli", "__main__"),
    ("robot_energy_papers",),
)
# Nothing online imports these.
OFFLINE = (
    "identify", "fleet", "report", "rig", "motion", "cli", "starter", "check", "page", "layouts",
    "optimization", "advice",
)  # fmt: skip
ONLINE = (
    "pipeline", "inputs", "messages", "accounting", "uncertainty", "condition", "store",
    "timeline", "cdr",
)  # fmt: skip
FOREIGN = {
    "ament_index_python", "builtin_interfaces", "control_msgs", "diagnostic_msgs",
    "lifecycle_msgs", "rclpy", "rosidl_runtime_py", "ros2_energy_monitor", "ros2_energy_msgs",
    "sensor_msgs", "std_msgs", "std_srvs", "trajectory_msgs",
}  # fmt: skip


def files():
    """Every module of the library by its dotted name."""
    return {
        ".".join(path.relative_to(SOURCES).with_suffix("").parts): path
        for package in ("robot_energy", "robot_energy_papers")
        for path in sorted((SOURCES / package).rglob("*.py"))
    }


@cache
def imports(path):
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.append(node.module)
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
    return tuple(found)


def part(module):
    """The package or module of the library that has a layer, of a dotted name."""
    names = module.split(".")
    return names[0] if names[0] == "robot_energy_papers" or len(names) == 1 else names[1]


def layer(name):
    return next(level for level, names in enumerate(LAYERS) if name in names)


def test_every_module_is_listed_and_every_listed_module_exists():
    listed = {f"{package}.{name}" for package, names in MODULES.items() for name in names.split()}
    found = {name for name in files() if not name.endswith("__init__")}
    assert found == listed


def test_modules_import_only_from_their_own_layer_and_below():
    for module, path in files().items():
        own = part(module)
        if own in ("robot_energy", "__init__"):  # the public API stands on everything
            continue
        for used in imports(path):
            if used.split(".")[0] in ("robot_energy", "robot_energy_papers"):
                below = part(used) == "robot_energy" or layer(part(used)) <= layer(own)
                assert below, f"{module} imports {used}, which stands above it"


def test_packages_import_each_other_in_no_circle():
    edges = {}
    for module, path in files().items():
        own = part(module)
        edges.setdefault(own, set()).update(
            part(used) for used in imports(path) if used.startswith("robot_energy.")
        )
        edges[own].discard(own)
    done, open_ = set(), []

    def visit(name):
        assert name not in open_, f"a circle of imports: {' -> '.join([*open_, name])}"
        if name not in done:
            open_.append(name)
            for used in sorted(edges.get(name, ())):
                visit(used)
            open_.pop()
            done.add(name)

    for name in sorted(edges):
        if name not in ("robot_energy", "__init__"):
            visit(name)


def test_no_public_class_has_the_name_of_another():
    names: dict[str, list[str]] = {}
    for module, path in files().items():
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                names.setdefault(node.name, []).append(module)
    assert {name: found for name, found in names.items() if len(found) > 1} == {}


def test_the_library_imports_no_ros():
    for module, path in files().items():
        used = {name.split(".")[0] for name in imports(path)}
        assert not used & FOREIGN, f"{module} imports {used & FOREIGN}"


def test_two_modules_import_pinocchio():
    found = {
        m for m, path in files().items() if "pinocchio" in {i.split(".")[0] for i in imports(path)}
    }
    assert found == {"robot_energy.physics.collision", "robot_energy.physics.rigid_body"}


@pytest.mark.parametrize(
    "heavy",
    ["matplotlib", "scipy", "rich", "clarabel", *(f"robot_energy.{name}" for name in OFFLINE)],
)
def test_nothing_online_imports_what_only_reports_need(heavy):
    online = ", ".join(f"robot_energy.{name}" for name in ONLINE)
    code = f"import sys, {online}; sys.exit('{heavy}' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_replay_with_its_report_loads_no_identification():
    code = (
        "import sys, robot_energy.replay.api, robot_energy_report.replay; "
        "sys.exit(any(name.startswith('robot_energy_identify') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
