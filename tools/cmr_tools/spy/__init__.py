"""cmr-spy: the channels on the bus, their rates, and the contents of their messages."""
