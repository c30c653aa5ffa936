"""Files that are read and written: regular ones only, and written complete or not at all."""
