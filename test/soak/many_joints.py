"""A cell of several arms as one model: more joints than any shipped model has."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path

from robot_energy.model import load, save, validate

ARM = "kr16"


def write_cell(folder: Path, arms: int) -> tuple[Path, Path]:
    """Write the model of several arms on one base, and the names of its joints.

    Args:
        folder: Where to.
        arms: Number of arms of six joints.

    Returns:
        The model file, and a JSON list of its joints.
    """
    model = load(ARM)
    arm = ET.fromstring(model.urdf_xml)
    cell = ET.Element("robot", name="cell")
    ET.SubElement(cell, "link", name="hall")
    data = model.model_dump(mode="json", exclude_none=True)
    data["joints"], data["payload"], data["coupling"] = [], [], []
    for number in range(arms):
        prefix = f"arm{number + 1}_"
        for element in arm:
            copy = deepcopy(element)
            if copy.tag not in ("link", "joint"):
                continue
            copy.set("name", prefix + str(copy.get("name")))
            for end in (*copy.findall("parent"), *copy.findall("child")):
                end.set("link", prefix + str(end.get("link")))
            cell.append(copy)
        children = {str(child.get("link")) for child in arm.findall("joint/child")}
        root = next(link for link in arm.findall("link") if link.get("name") not in children)
        mount = ET.SubElement(cell, "joint", name=f"{prefix}mount", type="fixed")
        ET.SubElement(mount, "parent", link="hall")
        ET.SubElement(mount, "child", link=prefix + str(root.get("name")))
        ET.SubElement(mount, "origin", xyz=f"{3.0 * number} 0 0", rpy="0 0 0")
        entry = model.model_dump(mode="json", exclude_none=True)
        for joint in entry["joints"]:
            data["joints"].append({**joint, "name": prefix + joint["name"]})
        for coupling in entry.get("coupling", []):
            data["coupling"].append(
                {**coupling, **{end: prefix + coupling[end] for end in ("motor", "joint")}}
            )
        for body in entry.get("payload", []):
            data["payload"].append({**body, "link": prefix + body["link"]})
    data["robot"] = {"type": f"cell of {arms} arms"}
    data["massless_links"] = [
        f"arm{number + 1}_{link}" for number in range(arms) for link in model.massless_links
    ]
    urdf = ET.tostring(cell, encoding="unicode")
    data["urdf"] = {"xml": urdf}
    path, names = folder / "cell.yaml", folder / "joints.json"
    cell_model = validate(data, str(path), urdf)
    save(cell_model, path)
    names.write_text(json.dumps(cell_model.joint_names))
    return path, names
