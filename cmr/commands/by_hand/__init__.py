"""Commands with which a person moves robots; `cmr.commands` itself holds as many files as one can have in view."""
