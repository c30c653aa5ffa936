"""Many bags of many robots: run, reported, identified."""
