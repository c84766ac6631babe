"""Commands with which a person moves robots."""
