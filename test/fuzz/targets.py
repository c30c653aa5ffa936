"""Everything that reads what others wrote, as functions of bytes that fail only on a fault.

The same targets run under Hypothesis in `make test` and guided by coverage in `make soak`.
"""

from __future__ import annotations

import gzip

import bag_lists
import bags
import containers
import files
import models
import motions
import online
import services
import stamps
import stray_stamps
import tables
import type_names
import yaml
from target import Target

TARGETS = {
    "online": Target(online.online, online.online_seeds),
    "outlier_stamps": Target(stray_stamps.outlier_stamps, stray_stamps.outlier_seeds),
    "stamps": Target(stamps.stamps, stamps.stamps_seeds),
    "model_file": Target(models.model_file, models.model_seeds),
    "urdf": Target(models.urdf, models.urdf_seeds),
    "first_model": Target(models.first_model, models.first_model_seeds),
    "mcap": Target(bags.mcap, bags.mcap_seeds),
    "containers": Target(containers.containers, containers.container_seeds),
    "message_definition": Target(containers.message_definition, containers.definition_seeds),
    "sqlite": Target(bags.sqlite, bags.sqlite_seeds),
    "bag_folder": Target(bags.bag_folder, bags.folder_seeds),
    "log_csv": Target(bags.log_csv, lambda: [bags.LOG, gzip.compress(bags.LOG, mtime=0)]),
    "log_ur": Target(bags.log_ur, bags.ur_seeds),
    "log_mapping": Target(bags.log_mapping, lambda: [yaml.safe_dump(bags.MAPPING).encode()]),
    "table_text": Target(tables.table_text, tables.text_seeds),
    "table_types": Target(tables.table_types, tables.types_seeds),
    "type_names": Target(type_names.type_names, type_names.type_seeds),
    "inputs_file": Target(models.inputs_file, models.inputs_seeds),
    "services": Target(services.services, services.service_seeds),
    "state_file": Target(models.state_file, models.state_seeds),
    "gcode": Target(motions.gcode, motions.gcode_seeds),
    "shape": Target(motions.shape, motions.shape_seeds),
    "moves_file": Target(motions.moves_file, motions.moves_seeds),
    "trajectory": Target(motions.trajectory, motions.trajectory_seeds),
    "addresses": Target(bag_lists.addresses, bag_lists.address_seeds),
    "file_arguments": Target(files.file_arguments, files.file_seeds),
    "trajectory_csv": Target(motions.trajectory_csv, motions.trajectory_csv_seeds),
}
