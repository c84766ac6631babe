"""How every command starts, parses its command line, reports and ends; independent of the rest of CMR.

`start` runs a command's `main`, `command_line` has the options that commands share and the exit codes, `options` makes
a dataclass a command line, `configuration` are a user's settings for all commands, `progress` and `news` print on the
terminal.
"""
