"""Select the effects of the catalogue that the data show, one model against another."""
