"""State files: what must outlive the process, on disk in two alternating slots."""
