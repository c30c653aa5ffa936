"""A log format of its own, in one file as a user writes it: angles in one column, at 100 Hz."""

from pathlib import Path

from robot_energy_logs.log_formats import LogFormat, register_log_format


def add_arguments(parser):
    parser.add_argument("log", metavar="LOG", help="file of angles [deg]")


def convert(log, out, joint_names, overwrite=False):
    from robot_energy_logs.log_import import import_log
    from robot_energy_logs.mapping import LogMapping

    mapping = LogMapping.model_validate(
        {
            "schema_version": 1,
            "column_names": ["angle"],
            "time": {"rate": 100.0},
            "joints": {
                "names": list(joint_names),
                "position": {"columns": ["angle"], "unit": "deg"},
            },
        }
    )
    return import_log(Path(log), mapping, out, overwrite)


KIND = register_log_format(
    LogFormat(
        name="angles",
        label="angles",
        line="one angle a line",
        description="Turn a file of angles into a bag.",
        add_arguments=add_arguments,
        run=lambda args: convert(args.log, args.out, ["axle"], args.overwrite),
        recording=convert,
    )
)
