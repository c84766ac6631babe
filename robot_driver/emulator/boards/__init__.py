"""What is inside of the emulated controllers, behind their protocols: tables of commands, motors, registers."""
