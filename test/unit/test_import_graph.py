"""Layers: which module may import which, for the complete list of modules.

A module that is not listed fails, so that every new one is given its place. The core imports no
companion, companions import those before them, and within each a module imports from its own
part and from those below. A part is a folder, or a module that stands elsewhere than its folder.
"""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import robot_energy

SOURCES = Path(robot_energy.__file__).parent.parent
MODULES = {
    "robot_energy": """
        __main__
    """,
    "robot_energy.accounting": """
        account account_record auxiliary averaging comparison energy_curve exact_sum
        job_intervals load_curve meter_checks meter_response plain_text power_curve record
        registers totals
    """,
    "robot_energy.bag": """
        mcap_file mcap_records mcap_writer metadata packed reader sources sqlite_source
        writer
    """,
    "robot_energy.bag.cdr": """
        decode encode lazy_store schema types walk
    """,
    "robot_energy.certainty": """
        band_calibration deviation energy_calibration figure_deviations
        friction_certainty prediction_errors priors
    """,
    "robot_energy.condition": """
        baseline drift fan_odds joint_friction learner meter_fit record thermal_observer
        thermal_state wear wear_records
    """,
    "robot_energy.foundation": """
        config_file described errors extras kinds options process_memory schema_errors
        shown shown_text stopping time_zone units
    """,
    "robot_energy.foundation.files": """
        first_bytes output_files output_folder placement
        regular_file temporary_folder
    """,
    "robot_energy.inputs": """
        auxiliary bag_topics inputs_file options parameters rejection_log remedies sources
    """,
    "robot_energy.inputs.joint_states": """
        correction decode joint_states partial_states plausibility publisher_conflicts
    """,
    "robot_energy.inputs.meter": """
        energy_counter kinds meter source
    """,
    "robot_energy.inputs.temperatures": """
        filter kinds reader stuck temperatures
    """,
    "robot_energy.messages": """
        fields friction model_messages payload power registers torque
    """,
    "robot_energy.model": """
        auxiliary drive_models figure friction_laws joint load payload schema
    """,
    "robot_energy.physics": """
        counterbalance derivative drives_and_cabinet drivetrain effort electrical_power
        equations friction hold_torque motor_heat pinocchio_model rigid_body
        torque_constant torque_limits
    """,
    "robot_energy.physics.urdf": """
        checks moving_joints parse
    """,
    "robot_energy.pipeline": """
        energy_pipeline friction_stage friction_timeline online_monitor power_stage
        settings torque_stage work_sums
    """,
    "robot_energy.replay": """
        api bag_replay energy_bag options power_table read_ahead recorded_jobs
        replay_steps setup
    """,
    "robot_energy.results": """
        auxiliary base energy replay
    """,
    "robot_energy.store": """
        account_store condition_store slots
    """,
    "robot_energy.timeline": """
        blocks pieces stamps streams time_series
    """,
    "robot_energy_cli": """
        advise check command commands completion export fleet_identify fleet_report
        fleet_run history identify_all identify_drives identify_dynamics
        identify_excitation identify_friction identify_inputs identify_metered
        identify_thermal import_logs info kinds layouts main model_reference models
        monitoring optimize predict replay replay_arguments report result_schema schema
        shared_bus simulate terminal test tool_options
    """,
    "robot_energy_fleet": """
        api bag_joints bag_list bag_places bag_row bag_sums dataset findings fleet_run identify
        merged_laws options report sisters tables
    """,
    "robot_energy_fleet.advice": """
        advise claims evidence
    """,
    "robot_energy_fleet.documents": """
        advice fleet
    """,
    "robot_energy_fleet.results": """
        advice fleet
    """,
    "robot_energy_history": """
        api bags check database differences jobs outputs queries readings rollup rows savings
        store tariffs use waiting_notes
    """,
    "robot_energy_identify": """
        auxiliary blas_threads bounds friction_and_thermal options plausibility provenance
        refused_recordings run_all steps
    """,
    "robot_energy_identify.api": """
        bag_source evaluate identify
    """,
    "robot_energy_identify.cabinet": """
        cabinet dc_link fan levels link_readings phase_readings supply thermometers
    """,
    "robot_energy_identify.check": """
        effort evidence field_lag finding meter meter_step motion possible_causes process remedies
        run torque torque_fit
    """,
    "robot_energy_identify.data": """
        bags log_channels observations recordings rest thinned
    """,
    "robot_energy_identify.drives": """
        all_drives delays drive_data drive_power drives efficiency_map losses
        total_covariance total_power total_sums
    """,
    "robot_energy_identify.dynamics": """
        base_parameters consistent dynamics dynamics_model leave_one_out
        torque_model validation
    """,
    "robot_energy_identify.excitation": """
        excitation limits
    """,
    "robot_energy_identify.friction": """
        friction further_terms hold laws samples shared_shape temperature_study
        torque_constants
    """,
    "robot_energy_identify.results": """
        evaluation identification
    """,
    "robot_energy_identify.starter": """
        arm description model_remarks model_text priors
    """,
    "robot_energy_identify.stats": """
        cross_validation held_out_energy lag regression systematic
    """,
    "robot_energy_identify.thermal": """
        gear gears_by_meter network
    """,
    "robot_energy_logs": """
        columns instants log_formats log_import mapping recording rows table text_table ur_rtde
    """,
    "robot_energy_papers": """
        calibration drawings drive_study experiment job_pool machines mantis models pages paper_a
        paper_a_page paper_b paper_b_page sensitivity soaked_rigs wall wall_sensitivity
    """,
    "robot_energy_papers.cli": """
        reproduce
    """,
    "robot_energy_plan": """
        options prediction shared_bus
    """,
    "robot_energy_plan.api": """
        optimize predict shared_bus
    """,
    "robot_energy_plan.motion": """
        fourier gcode gcode_arcs gcode_flavors gcode_machine gcode_words inverse_kinematics
        joint_trajectory load_motion planar planned ptp ptp_file sampled_motion slicing tool_corners
        tool_motion
    """,
    "robot_energy_plan.optimization": """
        chain comparison deviations gcode_form measures program_form rest_states search task
        time_law timed_moves trajectory_form
    """,
    "robot_energy_plan.results": """
        optimization prediction shared_bus
    """,
    "robot_energy_report": """
        canvas document drives dynamics energy energy_bars evaluation formats headline held_out
        history_month history_tables html identification identify_all jobs layouts
        model notebook optimization prediction printing recordings repeats replay
        replay_figures
    """,
    "robot_energy_report.page": """
        access alarms energy_flow headless_browser history history_figures history_view hub
        json_numbers messages metrics recording robot_state saved_page
        settings stale web_app web_server
    """,
    "robot_energy_rig": """
        config plant profile record sensors virtual_rig
    """,
    "robot_energy_studies": """
        band_coverage certainty ecbot generated_fleet independent interval_coverage learning_study
        savings savings_study thermal_study
    """,
    "robot_energy_studies.simulator": """
        arm cabinet drawn gear_friction heat motors recording robots
    """,
}
# From the ground up: the core, and what each companion may stand on.
PACKAGES = (
    ("robot_energy",),
    ("robot_energy_history", "robot_energy_logs"),
    ("robot_energy_plan",),
    ("robot_energy_rig", "robot_energy_identify"),
    ("robot_energy_report",),
    ("robot_energy_fleet",),
    ("robot_energy_cli",),
    ("robot_energy_papers",),
    ("robot_energy_studies",),
)
# Parts of a package from the ground up; each line may import from itself and from the lines above
# it. A part is a folder, or modules that stand elsewhere than their folder; "" is all the others.
LAYERS = {
    "robot_energy": (
        ("foundation", "physics.kernels"),
        ("timeline", "presets", "inputs.rejection_log", "__main__"),
        ("bag", "model", "inputs.meter.energy_counter"),
        ("physics", "accounting.power_curve"),
        ("certainty", "inputs"),
        ("accounting",),
        ("certainty.band_calibration",),
        ("accounting.account accounting.account_record",),
        (
            "pipeline.friction_stage pipeline.friction_timeline pipeline.power_stage "
            "pipeline.settings pipeline.torque_stage",
        ),
        ("condition",),
        ("pipeline", "store"),
        ("messages",),
        ("replay",),
        ("results",),
        ("replay.power_table",),
        ("replay.api", "pipeline.online_monitor"),
    ),
    "robot_energy_plan": (
        ("motion", "optimization.rest_states", "consecutive"),
        ("options",),
        ("prediction", "optimization", "shared_bus"),
        ("results",),
        ("api",),
    ),
    "robot_energy_identify": (
        ("starter", "blas_threads"),
        ("check",),
        ("",),
        ("results",),
        ("api",),
    ),
    "robot_energy_report": (
        ("layouts", "page"),
        ("",),
    ),
    "robot_energy_fleet": (
        ("results", "documents"),
        ("",),
        ("advice",),
    ),
}
# Besides the core the nodes stand on these companions: what the recorder writes, pages, the rig,
# predicted trajectories.
NODES = Path(__file__).resolve().parents[2] / "ros2_energy_monitor" / "ros2_energy_monitor"
OF_THE_NODES = {
    "robot_energy", "robot_energy_history", "robot_energy_plan", "robot_energy_report",
    "robot_energy_rig",
}  # fmt: skip
# The demo shows an identification too.
OF_THE_DEMO = {"demo/demo.py": {"robot_energy_identify"}}
# Nothing online imports these.
OFFLINE = (
    "robot_energy_cli", "robot_energy_fleet", "robot_energy_identify", "robot_energy_logs",
    "robot_energy_plan", "robot_energy_report", "robot_energy_rig",
)  # fmt: skip
ONLINE = (
    "accounting", "bag.cdr", "certainty", "condition", "inputs", "messages", "pipeline", "store",
    "timeline",
)  # fmt: skip
FOREIGN = {
    "ament_index_python", "builtin_interfaces", "control_msgs", "diagnostic_msgs",
    "lifecycle_msgs", "rclpy", "rosidl_runtime_py", "ros2_energy_monitor", "ros2_energy_msgs",
    "sensor_msgs", "std_msgs", "std_srvs", "trajectory_msgs",
}  # fmt: skip


@cache
def files():
    """Every module of the library by its dotted name."""
    return {
        ".".join(path.relative_to(SOURCES).with_suffix("").parts).removesuffix(".__init__"): path
        for packages in PACKAGES
        for package in packages
        for path in sorted((SOURCES / package).rglob("*.py"))
    }


@cache
def imports(path):
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found += [name if name in files() else node.module for name in names]
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
    return tuple(found)


def rank(package):
    return next(level for level, names in enumerate(PACKAGES) if package in names)


def place(module):
    """The package of a module, its part there, and the layer of that part."""
    package, _, inner = module.partition(".")
    layers = LAYERS.get(package, (("",),))
    fitting = [
        (len(name), part, level)
        for level, parts in enumerate(layers)
        for part in parts
        for name in part.split() or [""]
        if not name or inner == name or inner.startswith(f"{name}.")
    ]
    assert fitting, f"{module} has no layer"
    return package, *max(fitting)[1:]


def library_imports():
    """Each module that has a layer, and what it imports of the library."""
    for module, path in files().items():
        if module != "robot_energy":  # the one face: see the test of its own
            for used in imports(path):
                if used.partition(".")[0].startswith("robot_energy") and used != "robot_energy":
                    yield module, used


def test_every_module_is_listed_and_every_listed_module_exists():
    listed = {f"{package}.{name}" for package, names in MODULES.items() for name in names.split()}
    found = {name for name, path in files().items() if path.stem != "__init__"}
    assert found == listed
    assert {path.parent.name for path in SOURCES.glob("robot_energy*/__init__.py")} == {
        package for packages in PACKAGES for package in packages
    }


def test_modules_import_only_from_their_own_layer_and_below():
    for module, used in library_imports():
        (own, part, layer), (below, other, level) = place(module), place(used)
        said = f"{module} imports {used}, which stands above it"
        assert rank(below) < rank(own) or below == own, said
        if own == below and part != other:
            assert level <= layer, said


def test_parts_import_each_other_in_no_circle():
    edges = {}
    for module, used in library_imports():
        own, other = place(module)[:2], place(used)[:2]
        if own != other:
            edges.setdefault(own, set()).add(other)
    done, open_ = set(), []

    def visit(name):
        assert name not in open_, f"a circle of imports: {[*open_, name]}"
        if name not in done:
            open_.append(name)
            for used in sorted(edges.get(name, ())):
                visit(used)
            open_.pop()
            done.add(name)

    for name in sorted(edges):
        visit(name)


def test_the_face_names_the_companions_but_imports_none():
    """Only for type checkers does it import; what runs is a table of names."""
    tree = ast.parse(files()["robot_energy"].read_text())
    run = [node for node in tree.body if not isinstance(node, ast.If)]
    named = [
        node.module or ""
        for part in run
        for node in ast.walk(part)
        if isinstance(node, ast.ImportFrom)
    ]
    assert {name for name in named if name.startswith("robot_energy")} == {
        "robot_energy.foundation.extras"
    }


def test_the_core_runs_without_a_companion():
    core = [name for name in files() if name.partition(".")[0] == "robot_energy"]
    code = (
        f"import sys, {', '.join(core)}; "
        "sys.exit(any(name.startswith('robot_energy_') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_nodes_stand_on_the_core_and_the_companions_that_run_live():
    for path in sorted(NODES.rglob("*.py")):
        allowed = OF_THE_NODES | OF_THE_DEMO.get(path.relative_to(NODES).as_posix(), set())
        used = {name.partition(".")[0] for name in imports(path)}
        assert {name for name in used if name.startswith("robot_energy")} <= allowed, path


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
    names = "pinocchio_model", "rigid_body"
    assert found == {f"robot_energy.physics.{name}" for name in names}


def loaded_by(*modules):
    """Top packages that a fresh Python has loaded after it imported these."""
    code = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in run.stdout.split()}


def test_nothing_online_imports_what_only_reports_need():
    found = loaded_by(*(f"robot_energy.{name}" for name in ONLINE))
    assert not found & {"matplotlib", "scipy", "rich", "clarabel", "polars", *OFFLINE}


def test_a_replay_with_its_report_loads_none_of_what_others_need():
    found = loaded_by("robot_energy.replay.api", "robot_energy_report.replay")
    assert not found & {"robot_energy_identify", "robot_energy_plan", "robot_energy_history"}


def test_a_history_loads_neither_the_physics_nor_schemas():
    found = loaded_by("robot_energy_history.store")
    assert not found & {"pinocchio", "pydantic", "polars", "scipy"}
