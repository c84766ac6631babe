"""Generators of the documentation's pages, from the parsers of the commands and the message types."""
