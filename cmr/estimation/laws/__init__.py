"""Search for laws: formulas of the state that describe physics that no effect of the catalogue describes."""
