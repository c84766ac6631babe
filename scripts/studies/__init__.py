"""The work of the studies scripts/study_*: cases, parallel processes, tables and pictures."""
