"""cmr-spy: which channels there are on the bus, how fast, and what their messages say."""
