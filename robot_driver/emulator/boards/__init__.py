"""The emulated controllers behind their protocols: tables of commands, motors, registers."""
