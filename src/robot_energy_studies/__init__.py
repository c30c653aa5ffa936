"""How often the tool is right about itself; not in the wheel."""
