"""YAML files written by people: values with line numbers (`document`), and dataclasses from them (`structure`).

`declared` is how a dataclass declares its fields for files and for the command line.
"""
