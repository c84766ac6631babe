"""Generators of pages and pictures of the documentation, from parsers, message types, tables and recordings."""
