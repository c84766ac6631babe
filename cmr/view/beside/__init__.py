"""Additional pages besides viser's: each visitor gets a process, which alone handles the page's messages."""
