"""What is raised for a scenario that cannot be used."""

from cmr.documents.document import DocumentError


class ScenarioError(DocumentError):
    """A scenario cannot be used; the text names file, line and key, and says what is allowed."""
