"""YAML files that people write: values that know their line (`document`), and dataclasses from them (`structure`).

`declared` is how a dataclass says what its fields may be, in a file and on the command line.
"""
