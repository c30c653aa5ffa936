"""Records of decisions: each says whether it holds, and the index names each once."""

import re

from places import ROOT

FOLDER = ROOT / "src/doc/decisions"
RECORDS = {path.name: path for path in sorted(FOLDER.glob("0*.md"))}
STATUS = re.compile(r"\AStatus: (in force|(?:amended|replaced) by (.+?)\.(?=\s))", re.DOTALL)


def links(text: str) -> list[str]:
    """Records that a text links to."""
    return re.findall(r"\]\((0[\w-]+\.md)\)", text)


def test_each_record_states_its_status_and_its_number():
    for name, path in RECORDS.items():
        head, status = path.read_text().split("\n\n")[:2]
        assert re.fullmatch(rf"# {name[:4]} [A-Z].*", head), name
        found = STATUS.match(status + "\n")
        assert found, name
        later = links(found[2] or "")
        assert bool(later) is (found[1] != "in force"), name
        assert all(other in RECORDS and other > name for other in later), name


def test_the_index_names_each_record_once_and_what_changed_it():
    lines = (FOLDER / "index.md").read_text().splitlines()
    rows = {name: line for line in lines if line.startswith("- [") for name in links(line)}
    assert sorted(name for line in lines for name in links(line)) == sorted(RECORDS)
    for name, path in RECORDS.items():
        head, status = path.read_text().split("\n\n")[:2]
        assert head[2:].partition(" ")[2] in rows[name], name
        found = STATUS.match(status + "\n")
        assert found
        words = re.sub(r"\[(\d+)\]\([^)]*\)", r"\1", found[1]).rstrip(".")
        assert rows[name].endswith(
            head[2:].partition(" ")[2] if words == "in force" else f" ({words})"
        ), name
