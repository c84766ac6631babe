"""What the documentation's pages are written from: the parsers of the commands and the message types."""
