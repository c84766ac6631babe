"""How every command starts, reads its command line, reports and ends; it knows nothing else of CMR.

`start` runs a command's `main`, `command_line` has the options that commands share and the exit codes, `options` makes
a dataclass a command line, `configuration` is what a user sets once for all commands, `progress` and `news` are what
commands show on the terminal.
"""
